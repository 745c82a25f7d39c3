"""The leaderboard page in a real browser: Chromium, headless; skipped where there is none."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from tests.eval.test_page import CLIP, rendered

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium: `apt-get install chromium`")

VISIT = """<script>
const press = element => element.click();
const rows = () => [...document.querySelectorAll("tbody tr")];
const name = row => row.cells[0].dataset.value;
const shown = () => rows().filter(row => row.getClientRects().length).map(name);
const gap = label => rows().find(row => name(row) === label)
  .querySelector('[data-key="diff_mean"]').textContent;
const seen = {all: shown(), wide: document.documentElement.scrollWidth > innerWidth};
press(document.querySelector('[data-filter][data-value="none"]'));
seen.filtered = shown();
press([...document.querySelectorAll(".pick")].find(name => name.textContent === "osa"));
seen.after = gap("osa"); seen.other = gap("lq");
seen.against = document.querySelector(".against").textContent;
const heads = [...document.querySelectorAll("thead button")];
press(heads.find(head => head.textContent.startsWith("J mean")));
seen.sorted = shown();
const box = element => element.getBoundingClientRect();
const handles = [...document.querySelectorAll("button, a, summary")]
  .filter(e => e.getClientRects().length);
seen.unreachable = handles.filter(e => e.tabIndex < 0).map(e => e.textContent);
seen.small = handles.filter(e => box(e).height < 24).map(e => [e.textContent, box(e).height]);
const flights = document.querySelector(".flights"), image = flights.querySelector("img");
seen.closed = image.checkVisibility();
press(flights.querySelector("summary"));
seen.clip = [box(image).width, box(image).right <= innerWidth];
const out = document.createElement("pre");
out.id = "seen"; out.textContent = JSON.stringify(seen);
document.body.append(out);
</script>"""


def visit(tmp_path, width):
    costs = np.exp(np.random.default_rng(0).standard_normal(50))
    text, _ = rendered(("lq", costs), ("osa", 0.5 * costs), ("zero", 100 * costs), clips=[CLIP])
    page = tmp_path / "page.html"
    page.write_text(text.replace("</body>", VISIT + "</body>"), encoding="utf-8")
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path}",
    ]
    command += [f"--window-size={width},900", "--virtual-time-budget=4000", "--dump-dom"]
    done = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=120)
    found = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr
    return json.loads(found.group(1)), costs


@pytest.mark.parametrize("width", [1400, 500])
def test_rows_can_be_filtered_compared_and_sorted(tmp_path, width):
    seen, costs = visit(tmp_path, width)
    assert seen["all"] == ["osa", "lq", "zero", "blind"]
    assert not seen["wide"]
    assert seen["filtered"] == ["osa", "lq", "blind"]
    assert seen["against"] == "osa" and seen["after"] == "reference"
    mean, low, high = map(float, re.findall(r"-?[\d.]+", seen["other"]))
    assert mean == pytest.approx(0.5 * costs.mean(), rel=5e-3)
    assert low < mean < high
    assert seen["sorted"] == ["osa", "lq", "blind"]
    assert seen["unreachable"] == []  # by the keyboard
    assert width > 640 or seen["small"] == []  # by fingers
    assert not seen["closed"]  # nothing moves until it is asked to
    assert seen["clip"][0] > 200 and seen["clip"][1]
