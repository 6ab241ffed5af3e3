"""What is answered over HTTP: health, metrics, and the operators' pages with their JSON.

Nothing here decides about writing: orders go to the daemon, whose rules hold.
"""

from fieldlink.web.access import TOKEN_FILE
from fieldlink.web.metrics import render_metrics
from fieldlink.web.server import WebError, live_source, page_address, store_server, web_server

__all__ = [
    "TOKEN_FILE",
    "WebError",
    "live_source",
    "page_address",
    "render_metrics",
    "store_server",
    "web_server",
]
