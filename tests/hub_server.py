"""A stand-in for a server of published data sets, on the loopback address: lists, redirects, serves byte ranges."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

NAME, COMMIT = "travisdriver/phomo-data", "0123456789abcdef0123456789abcdef01234567"


class HubServer(ThreadingHTTPServer):
    """Serves `files` as one data set, those of more than `large` bytes as large files, with SHA-256."""

    daemon_threads = True

    def __init__(self, files: dict[str, bytes], large: int = 1000):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files
        self.large = large
        self.published = dict(files)
        """What the listing says; `files` may be spoiled afterwards."""
        self.break_after: int | None = None
        """Bytes of an answer after which every connection is cut."""
        self.ranges: list[tuple[str, str | None]] = []
        """Path and Range of each request for content."""
        self.ignore_ranges = False

    @property
    def endpoint(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def listing(self) -> list[dict]:
        """Entries as the server's tree tells them."""
        entries: list[dict] = [{"type": "directory", "path": "images", "oid": "0" * 40, "size": 0}]
        for path, content in self.published.items():
            oid = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()
            entry = {"type": "file", "path": path, "oid": oid, "size": len(content)}
            if len(content) > self.large:
                digest = hashlib.sha256(content).hexdigest()
                entry["lfs"] = {"oid": digest, "size": len(content), "pointerSize": 130}
            entries.append(entry)
        return entries


class _Handler(BaseHTTPRequestHandler):
    server: HubServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        path = unquote(urlsplit(self.path).path)
        if path == f"/api/datasets/{NAME}/revision/main":
            self._json({"id": NAME, "sha": COMMIT, "siblings": []})
        elif path == f"/api/datasets/{NAME}/tree/{COMMIT}":
            self._json(self.server.listing())
        elif path.startswith(f"/datasets/{NAME}/resolve/{COMMIT}/"):
            self.send_response(302)
            self.send_header("Location", "/content/" + path.split(f"/{COMMIT}/", 1)[1])
            self.send_header("Content-Length", "0")
            self.end_headers()
        elif path.removeprefix("/content/") in self.server.files:
            self._content(path.removeprefix("/content/"))
        else:
            kind = "RevisionNotFound" if "/revision/" in path and NAME in path else "RepoNotFound"
            kind = "EntryNotFound" if path.startswith("/content/") else kind
            self.send_response(404)
            self.send_header("X-Error-Code", kind)
            self.send_header("Content-Length", "0")
            self.end_headers()

    def _json(self, answer) -> None:
        body = json.dumps(answer).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _content(self, path: str) -> None:
        wanted, content = self.headers["Range"], self.server.files[path]
        self.server.ranges.append((path, wanted))
        start = 0
        if wanted and not self.server.ignore_ranges:
            start = int(wanted.removeprefix("bytes=").rstrip("-"))
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        else:
            self.send_response(200)
        body = content[start:]
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        limit = self.server.break_after
        self.wfile.write(body if limit is None else body[:limit])
        if limit is not None and limit < len(body):
            self.close_connection = True

    def log_message(self, *_) -> None:
        """Nothing on the terminal."""


@contextmanager
def serving(files: dict[str, bytes]) -> Iterator[HubServer]:
    """A server while the block lasts."""
    server = HubServer(files)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
