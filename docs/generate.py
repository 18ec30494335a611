"""mkdocs hooks that generate pages from code and data: protocols, drives, commands, API, pictures, changelog.

No generated page is stored in the repository, so none can be out of date.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from api_pages import api_pages
from commands_page import commands_page
from door_pictures import door_pictures
from http_api_page import http_api_page
from mkdocs.structure.files import File
from page_pictures import page_pictures
from pictures import pictures
from protocol_pages import overview, protocol_page
from supported_drives_page import MARK, PLACE, supported_drives

from drivecomm.protocol import installed

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

_LOG = logging.getLogger("mkdocs.hooks.generate")
_PROTOCOLS = "reference/protocols"
_API = "reference/api"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the pages of protocols and modules to the navigation, in their sections of mkdocs.yml."""
    parts = {name: pages for part in config.nav or [] for name, pages in part.items()}
    made = {
        "Protocols": [{plugin.title: f"{_PROTOCOLS}/{plugin.name}.md"} for plugin in installed.working()],
        "Python API": [{name: f"{_API}/{name}.md"} for name in api_pages()],
    }
    for section in parts.get("Reference", []):
        for name, pages in made.items():
            if name in section:
                section[name] += pages
    return config


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Insert the tables into the page of supported drives."""
    if page.file.src_uri != PLACE:
        return markdown
    return markdown.replace(MARK, supported_drives(installed.working()))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages; a protocol that cannot be loaded causes a warning, which fails strict builds."""
    for name, reason in installed.broken().items():
        _LOG.warning("no page for the protocol %s: %s", name, reason)
    plugins = list(installed.working())
    made = {f"{_PROTOCOLS}/index.md": overview(plugins), "reference/commands.md": commands_page()}
    made["reference/http-api.md"] = http_api_page()
    made |= {f"{_PROTOCOLS}/{plugin.name}.md": protocol_page(plugin) for plugin in plugins}
    made |= {f"{_API}/{name}.md": page for name, page in api_pages().items()}
    root = Path(config.config_file_path).parent
    made |= {f"pictures/{name}": picture for name, picture in pictures(root / ".cache" / "docs").items()}
    made |= {f"pictures/{name}": picture for name, picture in page_pictures(root / ".cache" / "docs").items()}
    made |= {f"pictures/{name}": picture for name, picture in door_pictures().items()}
    made["changelog.md"] = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    for place, content in made.items():
        files.append(File.generated(config, place, content=content))
    return files
