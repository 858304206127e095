"""Opens a report in headless Chromium without a network and works its controls.

    python check_page.py REPORT.html CHROMIUM

A copy of the page gets one more script that moves the scrubber, switches runs off and on, zooms and plays, and notes what
happened to the pixels; Chromium's own log gives errors of the console.
"""

import json
import pathlib
import re
import subprocess
import sys
import tempfile

PROBE = """
<script>
// A frame comes by the page's own (virtual) time, not when a loaded machine's compositor gets round to it: else playing
// can end before its first frame.
window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
window.cancelAnimationFrame = clearTimeout;
window.errors = [];
window.addEventListener("error", (event) => errors.push(String(event.message)));
const ink = (canvas) => {
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let hash = 0, painted = 0;
  for (let i = 0; i < pixels.length; i += 4) { if (pixels[i + 3]) painted++; hash = (hash * 31 + pixels[i] + 3 * pixels[i + 1] + 7 * pixels[i + 2] + 11 * pixels[i + 3]) | 0; }
  return { hash, painted };
};
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
(async () => {
  const found = { ready: document.body.dataset.ready, runs: document.querySelectorAll("#runs input").length };
  const animation = document.getElementById("animation"), series = document.querySelector("canvas.series");
  const scrubber = document.getElementById("scrubber");
  const scrub = (value) => { scrubber.value = value; scrubber.dispatchEvent(new Event("input")); };
  scrub(Number(scrubber.max) * 0.5);
  const before = ink(animation), beforeSeries = ink(series);
  scrub(Number(scrubber.max) * 0.5 + 0.13);
  found.scrubber_moves_robot = ink(animation).hash !== before.hash;
  found.scrubber_moves_cursor = ink(series).hash !== beforeSeries.hash;
  found.time = document.getElementById("now").textContent;
  const portrait = document.querySelector("#portraits canvas"), all = ink(portrait).hash;
  const boxes = [...document.querySelectorAll("#runs input")];
  boxes[0].click();
  found.toggle_hides = ink(portrait).hash !== all;
  boxes[0].click();
  found.toggle_shows_again = ink(portrait).hash === all;
  const wide = ink(series).hash, place = series.getBoundingClientRect();
  const point = (type, share) => series.dispatchEvent(new PointerEvent(type, { clientX: place.left + place.width * share, clientY: place.top + 50 }));
  point("pointerdown", 0.3); point("pointerup", 0.6);
  found.zoom = ink(series).hash !== wide;
  series.dispatchEvent(new MouseEvent("dblclick"));
  found.unzoom = ink(series).hash === wide;
  scrub(0);
  document.getElementById("play").click();
  await wait(600);
  document.getElementById("play").click();
  found.played_s = parseFloat(document.getElementById("now").textContent);
  found.view = (() => { const oblique = ink(animation).hash; const view = document.getElementById("view"); view.value = "side"; view.dispatchEvent(new Event("change")); return ink(animation).hash !== oblique; })();
  found.canvases = [...document.querySelectorAll("canvas")].filter((c) => c.offsetParent).map((c) => ({ label: c.getAttribute("aria-label") || c.id, painted: ink(c).painted }));
  found.rows = document.querySelectorAll("#torques tbody tr").length;
  found.outside = performance.getEntriesByType("resource").map((entry) => entry.name);
  found.wider_than_window = document.documentElement.scrollWidth > window.innerWidth;
  found.made = document.getElementById("subtitle").textContent;
  found.origin = document.getElementById("runs").textContent;
  found.errors = errors;
  const place2 = document.createElement("pre"); place2.id = "found"; place2.textContent = JSON.stringify(found); document.body.appendChild(place2);
})();
</script>
"""


def main():
    page, chromium = pathlib.Path(sys.argv[1]), sys.argv[2]
    # A desk's window and a telephone's: Chromium's narrowest.
    for size in ("1280,900", "500,900"):
        check(page, chromium, size)


def check(page, chromium, size):
    with tempfile.TemporaryDirectory() as folder:
        probed = pathlib.Path(folder) / "page.html"
        text = page.read_text()
        probed.write_text(text.replace("</body>", PROBE + "</body>"))
        result = subprocess.run(
            [chromium, "--headless=new", "--no-sandbox", "--disable-gpu", f"--window-size={size}",
             "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}/profile", "--enable-logging=stderr",
             "--virtual-time-budget=15000", "--dump-dom", probed.as_uri()],
            capture_output=True, text=True, timeout=180)
    match = re.search(r'<pre id="found">(.*?)</pre>', result.stdout, re.S)
    if not match:
        sys.exit(f"FAILED: the page did not finish\n{result.stderr[-3000:]}")
    found = json.loads(match[1].replace("&quot;", '"').replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">"))
    console = [
        # The probe reads pixels back; that remark of Chromium's is about the probe.
        line for line in result.stderr.splitlines() if "CONSOLE" in line and "willReadFrequently" not in line]
    problems = [f"console: {line}" for line in console] + [f"error: {text}" for text in found["errors"]]
    if found["ready"] != "yes":
        problems.append("the page is not ready")
    for name in ("scrubber_moves_robot", "scrubber_moves_cursor", "toggle_hides", "toggle_shows_again", "zoom", "unzoom", "view"):
        if not found[name]:
            problems.append(f"{name.replace('_', ' ')}: no")
    if not found["played_s"] > 0.1:  # 0.6 s of Chromium's virtual time, in steps of 16 ms
        problems.append(f"playing came to {found['played_s']} s")
    if not re.search(r"Made \d{4}-\d\d-\d\d \d\d:\d\d UTC by tandem \d", found["made"]) or "simulated, lockstep" not in found["origin"]:
        problems.append(f"made: {found['made']!r}; {found['origin']!r}")
    if any(not name.startswith("data:") for name in found["outside"]):
        problems.append(f"loads from outside: {found['outside']}")
    if found["wider_than_window"]:
        problems.append("the page is wider than its window")
    for canvas in found["canvases"]:
        if canvas["painted"] < 500:
            problems.append(f"{canvas['label']} is empty")
    if problems:
        sys.exit("FAILED: " + "\n  ".join(problems))
    print(f"{page} at {size}: {found['runs']} run(s), {len(found['canvases'])} drawings, {found['rows']} rows, controls work, no errors")


main()
