from .wire import (
    Json as Json,
    error_content as error_content,
    error_of as error_of,
    json_text as json_text,
    parsed as parsed,
    plain as plain,
    reading_of as reading_of,
    result_of as result_of,
    status_of as status_of,
)
