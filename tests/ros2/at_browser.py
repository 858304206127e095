"""A headless Chromium that a test looks at through its DevTools pipe: no port, no library."""

import base64
import json
import os
import pathlib
import subprocess
import time


class Browser:
    """One page in one Chromium. The DevTools protocol goes over descriptors 3 and 4, messages ended by a zero byte."""

    def __init__(self, chromium, profile, address, size="1280,800"):
        to_browser, self.to = os.pipe()
        self.back, from_browser = os.pipe()
        command = [
            chromium, "--headless=new", "--no-sandbox", "--disable-gpu", f"--window-size={size}", "--remote-debugging-pipe",
            f"--user-data-dir={profile}", "about:blank",
        ]

        def three_and_four():
            # Either may be one of them already.
            os.dup2(from_browser, 100)
            os.dup2(to_browser, 3)
            os.dup2(100, 4)

        self.process = subprocess.Popen(
            command, preexec_fn=three_and_four, pass_fds=(3, 4), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(to_browser)
        os.close(from_browser)
        os.set_blocking(self.back, False)
        self.number, self.text, self.events, self.session = 0, b"", [], None
        target = next(info for info in self.call("Target.getTargets")["targetInfos"] if info["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.call(f"{domain}.enable")
        self.call("Page.navigate", url=address)

    def call(self, method, seconds=30, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + seconds
        while True:
            *complete, self.text = self.text.split(b"\0")
            answers = [json.loads(text) for text in complete]
            self.events += [answer for answer in answers if "method" in answer]
            for answer in answers:
                if answer.get("id") == self.number:
                    assert "error" not in answer, answer
                    return answer["result"]
            assert time.monotonic() < deadline, f"{method}: no answer within {seconds} s"
            try:
                part = os.read(self.back, 1 << 16)
                assert part, "Chromium has ended"
                self.text += part
            except BlockingIOError:
                time.sleep(0.01)

    def run(self, script):
        """The value of an expression of the page's, awaited."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait(self, script, seconds):
        deadline = time.monotonic() + seconds
        while not self.run(script):
            assert time.monotonic() < deadline, f"after {seconds} s still not: {script}; {self.problems()}"
            time.sleep(0.05)

    def picture(self, path):
        pathlib.Path(path).write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def problems(self):
        """Exceptions, and errors of the console."""
        self.run("0")
        wrong = lambda event: (
            event["method"] == "Runtime.exceptionThrown"
            or event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] in ("error", "warning")
            or event["method"] == "Runtime.consoleAPICalled" and event["params"]["type"] in ("error", "warning")
        )
        return [event["params"] for event in self.events if wrong(event)]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)
        os.close(self.to)
        os.close(self.back)
