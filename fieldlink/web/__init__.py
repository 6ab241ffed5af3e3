"""What the daemon answers over HTTP: its health and its metrics."""

from fieldlink.web.metrics import render_metrics
from fieldlink.web.server import WebError, web_server

__all__ = ["WebError", "render_metrics", "web_server"]
