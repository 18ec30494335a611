"""The HTTP API reference is generated from the models that validate requests in the server."""

import re

from http_api_page import http_api_page

from drivecomm.server.http import description


def test_http_api_page_describes_every_request_and_response():
    page = http_api_page()
    for path, operations in description(local=True)["paths"].items():
        for method, operation in operations.items():
            assert f"\n## {method.upper()} {path} {{ #" in page
            assert operation["summary"] in page
    anchors = re.findall(r"\{ #([\w-]+) \}", page)
    assert len(anchors) == len(set(anchors))
    headings = {each.lower() for each in re.findall(r"^### (\w+)$", page, re.MULTILINE)}
    assert set(re.findall(r"\]\(#([\w-]+)\)", page)) <= {*anchors, *headings}


def test_http_api_page_shows_the_range_of_a_field():
    section = http_api_page().partition("## POST /api/v1/drives/{name}/lease {")[2].partition("\n## ")[0]
    assert "| `seconds` | body | number from 0.1 to 30 | yes |" in section
