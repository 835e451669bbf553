"""A headless Chromium by its DevTools protocol: what a page logs, what it computes, what it looks like."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import time
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any, Self

PROGRAM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
_OPTIONS = (
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--hide-scrollbars", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--force-color-profile=srgb",
)  # fmt: skip
_PATIENCE = 60.0  # seconds


class Browser:
    """A page in a browser that is closed at the end; ``folder`` is an empty one for its files."""

    def __init__(self, folder: Path, *, width: int = 900, height: int = 600) -> None:
        assert PROGRAM is not None
        options = [*_OPTIONS, f"--user-data-dir={folder}", f"--window-size={width},{height}", "about:blank"]
        silent = subprocess.DEVNULL
        self._process = subprocess.Popen([PROGRAM, *options], stdout=silent, stderr=silent, stdin=silent)
        port = self._port(folder / "DevToolsActivePort")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=_PATIENCE) as answer:
            (page,) = [each for each in json.load(answer) if each["type"] == "page"]
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=_PATIENCE)
        self._open(page["webSocketDebuggerUrl"].split(str(port), 1)[1], port)
        self._count = 0
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(_PATIENCE)

    def show(self, path: Path, fragment: str = "") -> None:
        """Load a page from the disk, and wait until it is there."""
        self.ask("Page.navigate", url="about:blank")
        self.ask("Page.navigate", url=path.as_uri() + fragment)
        until = time.monotonic() + _PATIENCE
        while not self.compute("document.readyState === 'complete' && typeof draw === 'function'"):
            assert time.monotonic() < until, "the page did not load"
            time.sleep(0.05)

    def compute(self, code: str) -> Any:
        """Return what JavaScript evaluates to."""
        answer = self.ask("Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def press(self, key: str, code: str = "") -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=key, code=code or key)

    def picture(self) -> bytes:
        """Return what is seen, as a PNG file."""
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])

    def ask(self, method: str, **arguments: Any) -> dict[str, Any]:
        """Ask the browser, and return its answer; what the page complains of meanwhile is kept."""
        self._count += 1
        self._send(json.dumps({"id": self._count, "method": method, "params": arguments}).encode())
        while True:
            told = json.loads(self._receive())
            if told.get("id") == self._count:
                assert "error" not in told, told
                result: dict[str, Any] = told["result"]
                return result
            what = told.get("params", {})
            if told.get("method") == "Runtime.exceptionThrown":
                self.complaints.append(json.dumps(what["exceptionDetails"]))
            elif told.get("method") == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert"):
                self.complaints.append(json.dumps(what["args"]))
            elif told.get("method") == "Log.entryAdded" and what["entry"]["level"] == "error":
                self.complaints.append(what["entry"]["text"])

    def _port(self, file: Path) -> int:
        until = time.monotonic() + _PATIENCE
        while not (file.exists() and file.read_text()):
            assert self._process.poll() is None, "the browser ended"
            assert time.monotonic() < until, "the browser did not start"
            time.sleep(0.05)
        return int(file.read_text().split()[0])

    def _open(self, path: str, port: int) -> None:
        key = base64.b64encode(os.urandom(16)).decode()
        head = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        self._socket.sendall(f"{head}Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self._socket.recv(1)
        assert b" 101 " in answer, answer

    def _send(self, content: bytes) -> None:
        mask, size = os.urandom(4), len(content)
        length = (
            struct.pack(">B", 128 | size)
            if size < 126
            else struct.pack(">BH", 254, size)
            if size < 65536
            else struct.pack(">BQ", 255, size)
        )
        self._socket.sendall(b"\x81" + length + mask + bytes(c ^ mask[i % 4] for i, c in enumerate(content)))

    def _receive(self) -> bytes:
        content = b""
        while True:
            first, size = self._read(2)
            size &= 127
            if size >= 126:
                size = int.from_bytes(self._read(2 if size == 126 else 8), "big")
            content += self._read(size)
            if first & 128:
                return content

    def _read(self, size: int) -> bytes:
        parts = bytearray()
        while len(parts) < size:
            part = self._socket.recv(size - len(parts))
            assert part, "the browser hung up"
            parts += part
        return bytes(parts)
