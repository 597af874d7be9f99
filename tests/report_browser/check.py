"""Drives Chromium over its DevTools pipe through a report: check.py CHROMIUM REPORT.html SCREENSHOTS

Shows that the page opens from disk with neither errors nor requests, that every picture is there, that the divider follows
a value, a pointer and the keyboard, that the choosers choose, and that no width makes the page scroll sideways. Nothing
but the standard library is needed: Chromium reads commands from its file descriptor 3 and answers on 4, JSON ended by
a zero byte.
"""

import base64
import fcntl
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SECONDS = 90
WIDTHS = {"wide": (1440, 900), "narrow": (390, 844)}
FLAGS = [
    "--headless", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-default-apps", "--disable-extensions",
    "--hide-scrollbars", "--remote-debugging-pipe",
]


class Failure(Exception):
    """What is wrong with the page, in one line."""


class Browser:
    """A headless Chromium with one page."""

    def __init__(self, chromium, profile):
        self.deadline = time.monotonic() + SECONDS
        self.buffer = b""
        self.events = []
        self.count = 0
        self.session = None
        # Far from the descriptors 3 and 4 that the shell gives them.
        pairs = [os.pipe(), os.pipe()]
        [child_in, self.commands], [self.answers, child_out] = [
            [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 20) for end in pair] for pair in pairs
        ]
        for pair in pairs:
            for end in pair:
                os.close(end)
        flags = FLAGS + ["--no-sandbox"] * (os.geteuid() == 0) + [f"--user-data-dir={profile}", "about:blank"]
        shell = f'exec "$@" 3<&{child_in} 4>&{child_out} {child_in}<&- {child_out}>&-'
        self.log = open(Path(profile) / "chromium.log", "wb+")
        self.process = subprocess.Popen(
            ["bash", "-c", shell, "bash", chromium, *flags], pass_fds=(child_in, child_out), stdin=subprocess.DEVNULL,
            stdout=self.log, stderr=self.log,
        )
        os.close(child_in)
        os.close(child_out)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def call(self, method, **params):
        """Result of a command."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.receive()
            if answer.get("id") == self.count:
                if "error" in answer:
                    raise Failure(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.events.append(answer)

    def receive(self):
        """The next message."""
        while b"\0" not in self.buffer:
            left = self.deadline - time.monotonic()
            if left <= 0 or not select.select([self.answers], [], [], left)[0]:
                raise Failure(f"Chromium did not answer within {SECONDS} s")
            part = os.read(self.answers, 1 << 20)
            if not part:
                self.log.seek(0)
                raise Failure(f"Chromium ended: {self.log.read().decode(errors='replace')[-2000:]}")
            self.buffer += part
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def wait_for(self, method):
        """Waits until an event has come since the last command."""
        while not any(event.get("method") == method for event in self.events):
            self.events.append(self.receive())

    def evaluate(self, expression):
        """Value of an expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise Failure(f"`{expression}` throws {answer['exceptionDetails'].get('exception', {}).get('description')}")
        return answer["result"].get("value")

    def mouse(self, kind, x, y):
        """A mouse event with the left button held."""
        pressed = 0 if kind == "mouseReleased" else 1
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=pressed, clickCount=1)

    def key(self, name):
        """A key pressed and released."""
        for kind in ("keyDown", "keyUp"):
            codes = {"ArrowRight": 39, "End": 35}
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=codes[name])

    def resize(self, size):
        """Sets the size of the window."""
        width, height = size
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def screenshot(self, path):
        """What the window shows, as PNG."""
        shot = self.call("Page.captureScreenshot")
        Path(path).write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        """Ends the browser."""
        try:
            self.session = None
            self.call("Browser.close")
            self.process.wait(10)
        except (Failure, OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
        self.log.close()


def expect(holds, complaint):
    """Fails with the complaint."""
    if not holds:
        raise Failure(complaint)


def check_silence(browser, page):
    """No message of an error, no exception, and no request but for the page itself and what is inside of it."""
    for event in browser.events:
        method, params = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            raise Failure(f"exception: {details.get('exception', {}).get('description', details['text'])}")
        if method == "Runtime.consoleAPICalled":
            expect(params["type"] not in ("error", "warning", "assert"), f"console: {params['args']}")
        if method == "Log.entryAdded":
            expect(params["entry"]["level"] not in ("error", "warning"), f"log: {params['entry']['text']}")
        if method == "Network.requestWillBeSent":
            url = params["request"]["url"]
            expect(url.split("#")[0] == page or url.startswith("data:"), f"request: {url[:200]}")


def check_pictures(browser):
    """Every picture is decoded."""
    total = browser.evaluate("document.images.length")
    expect(total > 0, "there is no picture")
    waiting = "Promise.all([...document.images].map((image) => image.decode().then(() => true, () => false)))"
    decoded = browser.evaluate(waiting)
    expect(all(decoded), f"{decoded.count(False)} of {total} pictures do not decode")
    missing = browser.evaluate("[...document.images].filter((i) => !i.complete || i.naturalWidth === 0).length")
    expect(missing == 0, f"{missing} of {total} pictures are missing")
    unnamed = browser.evaluate("[...document.images].filter((image) => !image.alt).length")
    expect(unnamed == 0, f"{unnamed} pictures have no alternative text")
    return total


# The picture over the other one, in the first viewer: what is cut off it, and where it is.
CLIP = "getComputedStyle(document.querySelector('.case:not(.off) .compare img.model:not(.off)')).clipPath"
BOX = """(() => {
    const box = document.querySelector('.case:not(.off) .compare');
    box.scrollIntoView({ block: 'center', behavior: 'instant' });
    const { x, y, width, height } = box.getBoundingClientRect();
    return [x, y, width, height];
})()"""
RANGE = "document.querySelector('.case:not(.off) .compare input')"


def cut(browser):
    """Percent that is cut off the left of the picture on top."""
    clip = browser.evaluate(CLIP)
    expect(clip.startswith("inset(") and clip.endswith("%)"), f"the picture on top is clipped by `{clip}`")
    return float(clip[:-2].split()[-1])


def check_divider(browser):
    """The divider follows the value of its control, the pointer and the keyboard."""
    browser.evaluate(f"{RANGE}.value = 20; {RANGE}.dispatchEvent(new Event('input', {{ bubbles: true }}))")
    expect(cut(browser) == 20, f"set to 20 %, the divider stands at {cut(browser)} %")
    x, y, width, height = browser.evaluate(BOX)
    middle = y + 0.4 * height
    browser.mouse("mousePressed", x + 0.3 * width, middle)
    pressed = cut(browser)
    for step in (0.4, 0.6, 0.75):
        browser.mouse("mouseMoved", x + step * width, middle)
    browser.mouse("mouseReleased", x + 0.75 * width, middle)
    dragged = cut(browser)
    # A control has steps of 0.5, a pointer whole pixels.
    expect(abs(pressed - 30) < 1 and abs(dragged - 75) < 1, f"dragged from 30 to 75 %, it went {pressed} to {dragged} %")
    browser.mouse("mouseMoved", x + 0.1 * width, middle)
    expect(cut(browser) == dragged, "the divider follows a pointer that was let go")
    browser.evaluate(f"{RANGE}.focus()")
    browser.key("ArrowRight")
    expect(cut(browser) > dragged, "the divider does not follow the arrow keys")
    browser.key("End")
    expect(cut(browser) == 100, "the divider does not follow the End key")
    browser.evaluate(f"{RANGE}.value = 50; {RANGE}.dispatchEvent(new Event('input', {{ bubbles: true }}))")


def check_choosers(browser):
    """Each choice shows one case, one model and one map, those that were chosen."""
    choices = browser.evaluate("""(() => {
        const viewer = document.querySelector('.viewer');
        const inputs = [...viewer.querySelectorAll('input[data-choice]')];
        const wrong = [];
        for (const input of [...inputs, ...inputs.filter((i) => i.defaultChecked)]) {
            input.click();
            const shown = (selector) => [...viewer.querySelectorAll(selector)].filter((e) => e.checkVisibility());
            const chosen = (key) => viewer.querySelector(`input[data-choice="${key}"]:checked`).value;
            const agrees = (e, keys) => keys.every((key) => e.dataset[key] === chosen(key));
            const [cases, models, maps] = ['.case', 'img.model', '.map img'].map(shown);
            const one = cases.length === 1 && models.length === 1 && maps.length === 1;
            if (!one || !agrees(cases[0], ['light', 'view']) || !agrees(models[0], ['model'])
                || !agrees(maps[0], ['model', 'map'])) wrong.push(`${input.dataset.choice} ${input.value}`);
        }
        return { count: inputs.length, wrong };
    })()""")
    expect(choices["count"] > 1, "there is nothing to choose")
    expect(not choices["wrong"], f"these choices show something else: {', '.join(choices['wrong'])}")
    return choices["count"]


def check_width(browser, name):
    """The page does not scroll sideways, with every fold open."""
    browser.evaluate("for (const fold of document.querySelectorAll('details')) fold.open = true")
    content, window = browser.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    expect(content <= window, f"{name}: the page is {content} pixels wide in a window of {window}")
    browser.evaluate("for (const fold of document.querySelectorAll('details')) fold.open = false")


def check(browser, report, screenshots):
    """All of it; one line of what was seen."""
    page = report.resolve().as_uri()
    for domain in ("Page", "Runtime", "Network", "Log"):
        browser.call(f"{domain}.enable")
    browser.resize(WIDTHS["wide"])
    browser.events.clear()
    # A page that cannot be opened is an answer with an error, not an event.
    answer = browser.call("Page.navigate", url=page)
    expect("errorText" not in answer, f"{page} does not open: {answer.get('errorText')}")
    browser.wait_for("Page.loadEventFired")
    pictures = check_pictures(browser)
    choices = check_choosers(browser)
    for name, size in WIDTHS.items():
        browser.resize(size)
        check_divider(browser)
        check_width(browser, name)
        # A window as high as the page: what lies below one is not always painted in a picture.
        browser.resize((size[0], browser.evaluate("document.documentElement.scrollHeight")))
        browser.evaluate("document.activeElement.blur(); window.scrollTo({ top: 0, behavior: 'instant' })")
        for scheme in ("light", "dark"):
            browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            browser.screenshot(screenshots / f"report-{name}-{scheme}.png")
    check_silence(browser, page)
    return f"{pictures} pictures, {choices} choices, divider by value, pointer and keys, widths {', '.join(WIDTHS)}: fine"


def main():
    """Exit code 0 if the page works, 1 if not."""
    chromium, report, screenshots = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    if not report.is_file():
        sys.exit(f"error: no report at {report}")
    screenshots.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(chromium, profile)
        try:
            print(f"{report}: {check(browser, report, screenshots)}")
        except Failure as failure:
            sys.exit(f"error: {report}: {failure}")
        finally:
            browser.close()


if __name__ == "__main__":
    main()
