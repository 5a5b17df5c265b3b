"""Opens a report in headless Chromium, as a reader would: every figure is there, nothing is cut off, no console error.

    pip install playwright
    apt-get install chromium-headless-shell        # or any other Chromium
    cargo build --release
    python tests/peers/page_check.py target/release/oblate [SCREENSHOTS]

Makes the fits of three mocks and their population in a minute, badly: the page is the same. With a folder SCREENSHOTS it keeps pictures of
the page, and the PDF that it prints as.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

BROWSERS = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"]

STUDY = """
title = "Three mocks"
out = "study"
allow_unconverged = true
[mocks]
count = 3
seed = 3
samplers = ["nested"]
[mocks.fit]
coarse_particles = 0
model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 }
prior.fixed = { r_s_halo_kpc = 15.0, r_s_prog_kpc = 2.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
sampling.nested = { n_live = 40, kernel = "random-slice", steps = 4, max_batches = 1 }
[population]
samplers = ["nested"]
settings.sampling.nested = { n_live = 60 }
"""

# Figures of a fit: fit, modes, q, corner, diagnostics; of a population: density, streams, influence, corner, diagnostics.
FIGURES = 3 * 5 + 5

# Widths of a desk, of a telephone, and of the text of a printed A4 page at 96 dots per inch.
DESK, TELEPHONE, A4 = 1400, 400, 680

# In the page: figures without a size or wider than what holds them, links that lead nowhere, text of figures out of its drawing, and by how
# much the page is wider than the screen.
LOOK = """() => {
  const figures = [...document.querySelectorAll('figure > svg')];
  const box = e => e.getBoundingClientRect();
  const empty = figures.filter(f => box(f).width < 100 || box(f).height < 50).length;
  const outside = figures.flatMap(f => [...f.querySelectorAll('text')].filter(t => {
    const [a, b] = [box(t), box(f)];
    return a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1;
  }).map(t => t.textContent));
  const links = [...document.querySelectorAll('a[href^="#"]')];
  const dead = links.filter(a => !document.getElementById(a.hash.slice(1))).length;
  const root = document.documentElement;
  return {figures: figures.length, empty, outside, links: links.length, dead, sideways: root.scrollWidth - root.clientWidth};
}"""


def look(page, what):
    found = page.evaluate(LOOK)
    print(what, found)
    assert found["figures"] == FIGURES, "a figure is missing"
    assert found["empty"] == 0, "a figure has no size"
    assert found["outside"] == [], "text is cut off"
    assert found["links"] > 0 and found["dead"] == 0, "a link leads nowhere"
    assert found["sideways"] <= 0, "the page scrolls sideways"


def main():
    oblate = Path(sys.argv[1]).resolve()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print("skipped: the page was not opened, because there is no Chromium (apt-get install chromium-headless-shell)")
        return
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        folder = Path(folder)
        (folder / "study.toml").write_text(STUDY)
        subprocess.run([oblate, "run", "study.toml", "-q"], cwd=folder, check=True, capture_output=True)
        kept = Path(sys.argv[2]) if len(sys.argv) > 2 else folder
        kept.mkdir(parents=True, exist_ok=True)
        chromium = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        complaints = []
        for width in (DESK, TELEPHONE):
            for scheme in ("light", "dark"):
                page = chromium.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
                page.on("console", lambda message: complaints.append(message.text))
                page.on("pageerror", lambda error: complaints.append(str(error)))
                page.on("requestfailed", lambda request: complaints.append(request.url))
                page.goto((folder / "study/report.html").as_uri())
                look(page, f"{width} pixels, {scheme}:")
                page.screenshot(path=kept / f"page_{width}_{scheme}.png", full_page=True)
        page = chromium.new_page(viewport={"width": A4, "height": 960})
        page.goto((folder / "study/report.html").as_uri())
        page.emulate_media(media="print")
        look(page, "printed:")
        page.pdf(path=kept / "page.pdf", prefer_css_page_size=True)
        assert complaints == [], complaints
        chromium.close()
    print("the page is whole")


if __name__ == "__main__":
    main()
