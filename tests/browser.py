"""Chromium without a screen or network, controlled by chromedriver with the WebDriver protocol of W3C."""

import base64
import json
import shutil
import subprocess
import tempfile
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

FLAGS = (
    *(
        "--headless",
        "--no-sandbox",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--window-size=1280,800", "--host-resolver-rules=MAP * ~NOTFOUND"),
)
PATIENCE = 60.0  # s that an answer may take
STARTS = 20  # starts of the driver: it takes a port of IPv6 that may be in use with IPv4, and ends


def is_there() -> bool:
    """Return whether Chromium and its driver are installed."""
    return bool(shutil.which("chromium") and shutil.which("chromedriver"))


class Browser:
    """A browser that shows one page after the other."""

    def __init__(self, address: str, options: dict):
        self.address = address
        self.session = f"/session/{self._ask('POST', '/session', options)['sessionId']}"

    def _ask(self, method: str, path: str, content: dict | None = None):
        data = None if content is None else json.dumps(content).encode()
        request = urllib.request.Request(
            self.address + path, data, {"Content-Type": "application/json"}, method=method
        )
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{path}: {json.load(error)['value']['message']}") from None

    def open(self, path: Path) -> None:
        """Open a file and wait until it is loaded."""
        self._ask("POST", f"{self.session}/url", {"url": path.resolve().as_uri()})

    def run(self, code: str):
        """Return the result of a function with this body in the page, or of its promise."""
        return self._ask("POST", f"{self.session}/execute/sync", {"script": code, "args": []})

    def picture(self) -> bytes:
        """Return the visible page as PNG."""
        return base64.b64decode(self._ask("GET", f"{self.session}/screenshot"))

    def faults(self) -> list[str]:
        """Return the errors on the console since the last call."""
        rows = self._ask("POST", f"{self.session}/se/log", {"type": "browser"})
        return [row["message"] for row in rows if row["level"] == "SEVERE"]

    def close(self) -> None:
        self._ask("DELETE", self.session)


def start_driver() -> tuple[subprocess.Popen, str]:
    """Start chromedriver on a free port; return its process and the port."""
    for _ in range(STARTS):
        driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        lines = []
        for line in driver.stdout:
            lines.append(line)
            if "successfully on port" in line:
                return driver, line.split("port ")[1].strip(".\n")
        driver.stdout.close()
        driver.wait(PATIENCE)
    raise AssertionError(f"chromedriver ended {STARTS} times, at last with: {''.join(lines)}")


@contextmanager
def browser(*flags: str):
    """Yield a browser with its own profile, which ends with the block; flags : in addition to FLAGS"""
    with tempfile.TemporaryDirectory() as folder:
        driver, port = start_driver()
        page = None
        try:
            chromium = {
                "args": [*FLAGS, *flags, f"--user-data-dir={folder}"],
                "binary": shutil.which("chromium"),
            }
            capabilities = {"goog:chromeOptions": chromium, "goog:loggingPrefs": {"browser": "ALL"}}
            page = Browser(f"http://127.0.0.1:{port}", {"capabilities": {"alwaysMatch": capabilities}})
            yield page
        finally:
            if page:
                page.close()
            driver.terminate()
            driver.wait(PATIENCE)
            driver.stdout.close()
