"""The report: what it says of runs whose results and defects are known, and how a browser shows it.

Known: the stress (harmonics of the parts in `sheared_runs`), the configuration, the defects put in on purpose. The
page must need nothing but itself, and hold its numbers as text.
"""

from __future__ import annotations

import base64
import html
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from sheared_runs import FLOW, NUMBER, PARTS, SCALES, sheared_run
from synthetic_runs import EDGE, configuration, oscillatory_record, steady_record, stress, write_run
from waiting import LIMIT

from suspend.errors import ConfigurationError, StorageError
from suspend.report import write_report
from suspend.report.examine import examine
from suspend.report.findings import findings
from suspend.report.text import duration, number, with_error

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIETLY = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr")
VOID = {"meta", "link", "img", "br"}


def lattice(side: int = 3) -> np.ndarray:
    """Simple cubic, far apart in the cell of edge 30: no overlaps."""
    axis = (np.arange(side) + 0.5) * EDGE / side
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def clean_run(path, cycles=16, *, positions=None, parts=PARTS, samples=64, change=lambda record: None, **options):
    """A finished run with equal cycles whose spheres walk a little; `change` spoils records."""
    start = lattice() if positions is None else positions
    config = configuration(FLOW, {"cycles": max(cycles, 1)}, number=len(start))
    random = np.random.default_rng(3)
    walk = start + np.cumsum(0.02 * random.normal(size=(cycles + 1, *start.shape)), axis=0) * options.get("walk", 1.0)
    records = []
    for k in range(cycles):
        record = oscillatory_record(k, SCALES, parts, samples, walk[k])
        record["statistics"] |= {"position_error": 1e-6, "wall_time": 30.0, "iterations": 900, "steps": 70}
        change(record)
        records.append(record)
    return write_run(path, config, records, walk[-1] if options.get("finished", True) else None)


@pytest.fixture
def without_figures(monkeypatch):
    """Most of a report's time are its figures."""
    monkeypatch.setattr("suspend.report.write.figures_of", lambda run: [])


def names(path):
    return [finding.name for finding in findings(examine(path))]


def words(page: str) -> str:
    """The page's text without tags and styles."""
    body = re.sub(r"<(style|script)>.*?</\1>", "", page, flags=re.DOTALL)
    body = re.sub(r"<(/?(td|th|tr|p|h\d|li|div)\b)", r" <\1", body)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", "", body)).replace("\xa0", " "))


def test_numbers():
    """Rounding, signs and powers as people write them."""
    assert words(number(-0.00012345)) == "−1.234 × 10−4" or words(number(-0.00012345)) == "−1.235 × 10−4"
    assert number(1e-5) == "1&nbsp;×&nbsp;10<sup>−5</sup>"
    assert number(2.5) == "2.5" and number(0.0) == "0" and number(float("nan")) == "–" and number(None) == "–"
    assert words(with_error(2.79826, 0.00079)) == "2.79826 ± 0.00079"
    assert words(with_error(-12.3, 4.0)) == "−12.3 ± 4.0"
    assert words(with_error(1.376e-6, 9.8e-8)) == "(1.376 ± 0.098) × 10−6"
    assert words(with_error(3.0, float("nan"))) == "3"
    assert words(duration(75.0)) == "75 s" and words(duration(600.0)) == "10 min" and words(duration(1e5)) == "27.8 h"


def test_clean_run(tmp_path):
    """No warnings; the known moduli, the configuration, cost and errors are in the text."""
    path = clean_run(tmp_path / "calm")
    assert names(path) == []
    assert write_report([path], tmp_path / "r.html") == []
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    text = words(page)
    assert "<title>Report on calm</title>" in page and "No warnings" in text
    # eta_1' = 1 (fluid) + 3/(eta0 gamma0 omega), -eta_3'/eta_1' = (0.1/1.6)/eta_1', G_1' = 0.2/1.6, nu_0 = -yy/1.6
    first = 1.0 + 3.0 / 1.6
    for value in (first, 0.125, 0.1 / 1.6 / first):
        assert f"{value:.4g}" in text
    assert "0.1875 " in text and "−0.1875 " in text  # nu_0 of N1 = 0.3/1.6 and of N2
    for piece in ("oscillatory shear", "φ = 0.1", "N = 27", "γ0 = 0.8", "amplitude: 0.8", "Wall time", "8 min"):
        assert piece in text, piece
    for piece in ("Position error of a cycle, estimated", "Near-field velocity solve", "statistical", "Integrator"):
        assert piece in text, piece


def test_page_needs_nothing_else(tmp_path):
    """No address but data: in any attribute or style, well-formed tags, images that are what they say."""
    write_report([clean_run(tmp_path / "calm")], tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert not re.search(r"url\(|@import|<script|https?://", page)
    parser = Tags()
    parser.feed(page)
    assert not parser.open and parser.sources
    assert all(source.startswith("data:") for source in parser.sources)
    images = [base64.b64decode(s.split(",", 1)[1]) for s in parser.sources if s.startswith("data:image")]
    assert len(images) >= 9
    assert all(image.startswith((b"<?xml", b"\x89PNG")) for image in images)


class Tags(HTMLParser):
    """Collects addresses, checks that tags are closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.sources = [], []

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        self.sources += [value for name, value in attributes if name in ("src", "href") and value[:1] != "#"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_same_runs_make_the_same_figures(tmp_path):
    """Nothing random and no date inside the images."""
    path = clean_run(tmp_path / "calm", 4)
    pages = []
    for name in ("a.html", "b.html"):
        write_report([path], tmp_path / name)
        pages.append(re.findall(r"data:image[^\"]*", (tmp_path / name).read_text()))
    assert pages[0] == pages[1]


def spoil_overlaps(record):
    record["statistics"]["overlaps"] = 2


def spoil_samples(record):
    if record["index"] == 3:
        keep = np.arange(0, 64, 2)
        for name in [n for n in record if n.startswith("stress_")] + ["time", "strain", "rate", "phase"]:
            record[name] = record[name][keep]


def drifting(record):
    record["stress_hydrodynamic"] *= 1.0 - 0.05 * record["index"] / 16


def noisy(record):
    record["statistics"]["position_error"] = 0.05


RICH = PARTS | {"hydrodynamic": lambda t: stress(3.0 * np.cos(t) + 0.2 * np.cos(7 * t))}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"change": spoil_overlaps}, ["overlaps"]),
        ({"change": spoil_samples}, ["missing samples"]),
        ({"change": drifting}, ["not steady"]),
        ({"change": noisy}, ["D<sub>cyc</sub> near the integrator's error"]),
        ({"finished": False}, ["unfinished run"]),
        ({"samples": 24}, ["missing samples", "under-resolved"]),
        ({"parts": RICH}, ["under-resolved"]),
        ({"cycles": 2}, ["too few cycles"]),
    ],
)
def test_each_defect_is_named(tmp_path, without_figures, options, expected):
    """One defect, one warning, on the page too. Harmonic 7 is 0.2/(3 + 1.6) = 4 % in the rich stress."""
    path = clean_run(tmp_path / "run", **options)
    assert names(path) == expected
    write_report([path], tmp_path / "r.html")
    text = words((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert words(expected[0]) + ": " in text and "No warnings" not in text


def test_late_drift(tmp_path):
    """A viscosity that is steady around total strain 100 and settles 5 % lower later has drifted since."""

    def late(record):
        strain = 3.2 * record["index"]
        record["stress_hydrodynamic"] *= 1.0 if strain < 110.0 else 0.95

    noise = np.random.default_rng(5)

    def change(record):
        late(record)
        record["stress_hydrodynamic"] *= 1.0 + 1e-3 * noise.normal()

    found = dict(findings(examine(clean_run(tmp_path / "run", 80, change=change))))
    assert "drifted" in found
    change = float(re.search(r"by −([\d.]+) %", words(found["drifted"])).group(1))
    assert change == pytest.approx(100.0 * 0.05 * 3.0 / 4.6, abs=0.1)  # of 3 + 1.6, 3 became 2.85


def test_crystal(tmp_path):
    """108 spheres on an fcc lattice of touching distance 2.1: crystallised, Q6 = 0.57; random ones are not."""
    cell = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    corners = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    fcc = (corners[:, None] + cell).reshape(-1, 3) * 2.1 * np.sqrt(2.0) + 5.0  # a crystallite in the cell
    path = clean_run(tmp_path / "run", 4, positions=fcc, walk=0.01)
    found = dict(findings(examine(path)))
    assert "crystallised" in found
    assert "Q6 is 0.57" in words(found["crystallised"])
    random = np.random.default_rng(1).uniform(0.0, EDGE, (108, 3))
    loose = clean_run(tmp_path / "loose", 4, positions=random)
    assert "crystallised" not in names(loose)


def test_many_runs(tmp_path):
    """A row with a link for each, figures against the amplitude, and what could not be read, with the reason."""
    paths = []
    for gamma0 in (0.4, 0.8):
        scales = SCALES | {"gamma0": gamma0}
        records = [oscillatory_record(k, scales, PARTS, 64, lattice()) for k in range(5)]
        config = configuration(FLOW | {"amplitude": gamma0}, {"cycles": 5}, number=27)
        paths.append(write_run(tmp_path / f"g{gamma0}", config, records, lattice()))
    (tmp_path / "foreign.h5").write_bytes(b"no run")
    notes = write_report([*paths, paths[0], tmp_path / "foreign.h5"], tmp_path / "r.html", title="A <sweep> & more")
    assert len(notes) == 1 and "foreign.h5" in notes[0]
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<h1>A &lt;sweep&gt; &amp; more</h1>" in page
    assert page.count('<section class="run"') == 2
    assert '<a href="#run-2">g0.8</a>' in page and 'id="run-2"' in page
    assert "Against the amplitude" in page and "Not read" in page
    assert f"{1.0 + 3.0 / 0.8:.4g}" in words(page)


@pytest.mark.parametrize(
    ("flow", "signs", "averaged"),
    [
        ({"type": "steady", "rate": 1.0}, [1.0] * 6, 3),
        ({"type": "reversal", "rate": 1.0, "reversal_strain": 3.0}, [1.0] * 3 + [-1.0] * 3, 1),
        ({"type": "quiescent", "rate": 1.0}, [0.0] * 6, 3),
    ],
)
def test_other_flows(tmp_path, flow, signs, averaged):
    """Averages over the last half of the blocks since the reversal: eta_r = (2 + 6)/2 = 4 for the stresses below."""
    scales = {"rate": 1.0, "viscosity": 2.0}
    records = [steady_record(k, scales, stress(np.full(16, 6.0 * s)), s) for k, s in enumerate(signs)]
    for record in records:
        record["position"][0] = record["unwrapped"][0] = lattice()[:4]
    path = write_run(tmp_path / "run", configuration(flow, {"strain": 6.0}), records, lattice()[:4])
    write_report([path], tmp_path / "r.html")
    text = words((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "ηr, relative viscosity 4 " in text or flow["type"] == "quiescent"
    assert f"last {averaged} of 6 blocks" in text


def test_drift_of_steady_shear(tmp_path):
    """A viscosity that falls by a tenth over the last half of the blocks is not steady; a constant one is."""
    scales, config = {"rate": 1.0, "viscosity": 2.0}, configuration({"type": "steady", "rate": 1.0}, {"strain": 20.0})
    noise = np.random.default_rng(2).normal(size=20)
    for name, slope, expected in (("falls", 0.02, ["not steady"]), ("stays", 0.0, [])):
        levels = 6.0 * (1.0 - slope * np.arange(20)) + 0.01 * noise
        records = [steady_record(k, scales, stress(np.full(16, level))) for k, level in enumerate(levels)]
        for record in records:
            record["position"][0] = record["unwrapped"][0] = lattice()[:4]
        assert names(write_run(tmp_path / name, config, records, lattice()[:4])) == expected


@pytest.mark.parametrize("number_of_spheres", [1, 2])
def test_few_spheres(tmp_path, without_figures, number_of_spheres):
    """One or two spheres: the rest of the report, and what is missing with the reason."""
    path = clean_run(tmp_path / "run", 4, positions=lattice()[:number_of_spheres])
    write_report([path], tmp_path / "r.html")
    text = words((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "2.875" in text
    assert ("Missing" in text) == (number_of_spheres == 1)


@pytest.mark.parametrize("cycles", [0, 1])
def test_short_runs(tmp_path, cycles):
    """Without a cycle, or with one: said so, no invented error."""
    path = sheared_run(tmp_path / "run", cycles, finished=cycles > 0)
    write_report([path], tmp_path / "r.html")
    text = words((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert ("nothing to analyse" in text) if cycles == 0 else ("too few cycles" in text and "2.875" in text)


@pytest.mark.parametrize("kind", ["absent", "empty", "foreign", "truncated"])
def test_runs_that_cannot_be_read(tmp_path, kind):
    """A single one: the error itself, no page."""
    content = (clean_run(tmp_path / "run", 4) / "trajectory.h5").read_bytes()
    source = tmp_path / "source.h5"
    if kind != "absent":
        source.write_bytes({"empty": b"", "foreign": b"hello" * 99, "truncated": content[: len(content) // 2]}[kind])
    with pytest.raises(StorageError, match=r"source\.h5"):
        write_report([source], tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_wrong_requests(tmp_path):
    """Suffix, folder, no runs: refused before anything is read."""
    for target, runs in (("r.pdf", ["x"]), ("r", ["x"]), ("r.html", [])):
        with pytest.raises(ConfigurationError):
            write_report(runs, tmp_path / target)
    (tmp_path / "d.html").mkdir()
    with pytest.raises(ConfigurationError, match="is a folder"):
        write_report(["x"], tmp_path / "d.html")
    with pytest.raises(StorageError, match="cannot write"):
        write_report([clean_run(tmp_path / "run", 4)], tmp_path / "nowhere" / "r.html")


def test_command(tmp_path):
    """The command writes the page; errors have their exit codes."""
    path = clean_run(tmp_path / "run", 4)

    def command(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "suspend_cli", "report", *map(str, arguments)], capture_output=True, text=True
        )

    done = command(path, "-o", tmp_path / "r.html", "--title", "Mine", "--last", "2")
    assert done.returncode == 0 and done.stdout == "" and "written" in done.stderr, done.stderr
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<title>Mine</title>" in page and "last 2 of 4 cycles" in words(page)
    assert command(path, "-o", tmp_path / "r.txt").returncode == 2
    assert command(tmp_path / "none", "-o", tmp_path / "r.html").returncode == 4


PROBE = """<script>
const images = [...document.images];
const wide = [...document.querySelectorAll("body *")].filter(
  e => !e.closest(".wide, pre, details") && e.getBoundingClientRect().right > innerWidth + 1);
document.body.dataset.probe = JSON.stringify({
  images: images.length, broken: images.filter(i => !i.complete || !i.naturalWidth).length,
  scroll: document.documentElement.scrollWidth, width: innerWidth, wide: wide.map(e => e.outerHTML.slice(0, 80)),
  background: getComputedStyle(document.body).backgroundColor, ink: getComputedStyle(document.body).color});
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine: the page is not opened in a browser")
@pytest.mark.parametrize(("width", "dark"), [(390, False), (1280, False), (800, True)])
def test_in_a_browser(tmp_path, width, dark):
    """A real browser: no console messages, title and numbers in the DOM, images load, nothing is wider than a phone,
    the screenshot is not blank, and a dark page has light letters."""
    import json

    from matplotlib.image import imread

    paths = [clean_run(tmp_path / "calm"), clean_run(tmp_path / "unsteady", change=drifting)]
    write_report(paths, tmp_path / "r.html")
    probed = tmp_path / "probed.html"
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    probed.write_text(page.replace("</body>", PROBE + "</body>"), encoding="utf-8")

    def browse(*options, file):
        scheme = [f"--user-data-dir={tmp_path / 'profile'}"]
        scheme += ["--blink-settings=preferredColorScheme=0"] if dark else []
        done = subprocess.run(
            [CHROMIUM, *QUIETLY, *scheme, *options, f"--window-size={width},1400", file.as_uri()],
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
        assert done.returncode == 0, done.stderr
        assert "CONSOLE" not in done.stderr, done.stderr
        return done.stdout

    dom = browse("--dump-dom", file=probed)
    assert "<title>Report on 2 runs</title>" in dom
    assert "not steady" in words(dom) and f"{1.0 + 3.0 / 1.6:.4g}" in words(dom)
    probe = json.loads(html.unescape(re.search(r'data-probe="([^"]*)"', dom).group(1)))
    assert probe["images"] >= 18 and probe["broken"] == 0
    assert probe["wide"] == [] and probe["scroll"] <= probe["width"]
    shades = [sum(map(int, re.findall(r"\d+", probe[name])[:3])) for name in ("background", "ink")]
    assert (shades[0] < shades[1]) == dark
    browse(f"--screenshot={tmp_path / 'shot.png'}", file=tmp_path / "r.html")
    picture = imread(tmp_path / "shot.png")[..., :3]
    assert picture.shape[:2] == (1400, width)
    background = picture[2, 2]
    inked = np.abs(picture - background).max(axis=-1) > 0.2
    assert 0.01 < inked.mean() < 0.8
    assert (inked.reshape(14, 100, -1).any(axis=(1, 2))).sum() >= 12  # ink on nearly every strip of the page


def test_sheared_frames(tmp_path):
    """The run of the export tests: overlapping spheres in its positions are found."""
    assert NUMBER == 12
    assert "overlaps" in names(sheared_run(tmp_path / "run", 8))
