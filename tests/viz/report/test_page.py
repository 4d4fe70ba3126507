"""Tests of the page about a run, without a browser."""

import base64
import json
import re
import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml

from geoskill.skill.checkpoint import Provenance
from geoskill.viz.report.curves import curves_of, read_top_lines, runs_of
from geoskill.viz.report.page import About, write_report
from geoskill.viz.report.plots import smoothed
from tests.viz.report.report_runs import FRAMES, HOSTILE, line_of, write_run

ABOUT = About("infer", [("Again:", "python infer.py")])
ORIGIN = Provenance((HOSTILE,), (640, 480), "2026-01-01", "1.2.3", 7, True, (16, 16), {"rsw": 0.25})


class Content(HTMLParser):
    """Texts outside of scripts and styles, and everything that the page refers to."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.text: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self._is_code = False
        self.feed(re.sub(r"<script>.*?</script>", "<script></script>", page, flags=re.DOTALL))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self._is_code = tag in ("script", "style")
        self.references += [value or "" for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if not self._is_code:
            self.text.append(data)

    def handle_endtag(self, tag: str) -> None:
        self._is_code = False


def test_page_says_what_the_run_holds(tmp_path: Path) -> None:
    page = write_report(write_run(tmp_path / "run"), About("train", [("Then:", "python infer.py")], ORIGIN))
    content = Content(page.read_text(encoding="utf-8"))
    text = " ".join("".join(content.text).split())
    for expected in (
        "A thing is moved until one point comes onto another.",
        "The features that were learned come together in the demonstration.",
        "One point comes onto another: a moved point and a resting point.",
        "moving point → resting point",
        "done when what is left to the goal is within3 px",
        "distance at the start290 px",
        "seen best in frame 12",
        "settles at 80 %; over when what is left of p2p_sift below 6",
        "How often associations of a confidence are right",
        "last rsw0.25",
        "video=demo.mp4",
        "inference: {abstain: 0.2}",
        "Then:python infer.py",
        "associations.jsonl, metrics.csv, metrics.json, overlay.mp4, skill.yaml",
    ):
        assert expected in text
    # One error and one confidence plot, two of the training, one of reliability.
    assert len(re.findall(r'<div id="[^"]+" data-root-id', page.read_text())) == 5


def test_page_needs_nothing_but_files_beside_it(tmp_path: Path) -> None:
    page = write_report(write_run(tmp_path / "run"), ABOUT).read_text(encoding="utf-8")
    references = Content(page).references
    assert sum(reference.startswith("data:image/") for reference in references) == 4
    names = {reference for reference in references if not reference.startswith("data:")}
    assert names == {"associations.jsonl", "metrics.csv", "metrics.json", "overlay.mp4", "skill.yaml"}
    assert "default-src &#39;none&#39;" in page
    assert base64.b64encode((tmp_path / "run" / "overlay.mp4").read_bytes()).decode() in page


def test_large_video_stays_beside_the_page(tmp_path: Path) -> None:
    page = write_report(write_run(tmp_path / "run"), ABOUT, max_embedded_mb=1e-4).read_text(encoding="utf-8")
    assert '<video id="video" controls muted playsinline preload="auto" src="overlay.mp4">' in page
    assert "The video is large and not part of this page" in page
    assert 'id="video-data"' not in page


def test_hostile_names_are_text(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", HOSTILE)
    page = write_report(run, About("infer", [("Again:", HOSTILE)], ORIGIN)).read_text(encoding="utf-8")
    content = Content(page)
    assert HOSTILE in "".join(content.text)
    assert "window.hacked" not in re.sub(
        r"&lt;/script&gt;&lt;script&gt;window.hacked = 1&lt;|window.hacked = 2&#39;", "", page
    )
    assert "x" not in content.references


def test_no_other_picture_gets_into_the_page(tmp_path: Path) -> None:
    """A definition may be from anybody, and the page is handed on."""
    run = write_run(tmp_path / "run")
    for name in (tmp_path / "secret.png", run / "first.jpg"):
        name.write_bytes(b"secret")
    definition = yaml.safe_load((run / "skill.yaml").read_text())
    bad = (
        "../../secret.png",
        "definition/../../secret.png",
        str(tmp_path / "secret.png"),
        "first.jpg",
        "definition/a-1-moving.png/../../first.jpg",
    )
    nodes = [{"type": "point", "role": "moving", "picture": path} for path in bad]
    definition["members"]["p2p_sift"]["associations"][0]["nodes"] = nodes
    (run / "skill.yaml").write_text(yaml.safe_dump(definition))
    page = write_report(run, ABOUT).read_text(encoding="utf-8")
    assert base64.b64encode(b"secret").decode() not in page
    assert sum(reference.startswith("data:image/") for reference in Content(page).references) == 2


def test_page_of_a_run_whose_definition_is_elsewhere(tmp_path: Path) -> None:
    """Its frames are those of the demonstration; what it says over time comes from the lines that are given."""
    demonstrated, run = write_run(tmp_path / "skill"), tmp_path / "run"
    run.mkdir()
    lines = [line_of(frame) for frame in range(FRAMES)]
    page = write_report(run, About("evaluate", [], ORIGIN, demonstrated, lines)).read_text(encoding="utf-8")
    text = " ".join("".join(Content(page).text).split())
    assert "seen best in frame 12 of the demonstration" in text
    assert "At the end of the demonstration" in text
    assert 'class="seek"' not in page
    assert f'id="slider" min="0" max="{FRAMES - 1}"' in page


def test_page_of_a_definition_that_cannot_be_read(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    (run / "skill.yaml").write_text("a: &x [1]\nb: *x\n")
    text = "".join(Content(write_report(run, ABOUT).read_text(encoding="utf-8")).text)
    assert "Run run" in text
    assert "What the task is" not in text


def test_what_is_determined_is_a_table_in_words(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    metrics = json.loads((run / "metrics.json").read_text())
    weak = [{"motion": "the line of sight", "mm": 72.1, "deg": 1.06}]
    metrics["decidability"] = {
        "one_camera": {"determined": 3, "of": 4, "free": ["the turn"], "weak": weak},
        "two_cameras": {"determined": 4, "of": 4, "free": [], "weak": []},
        "depth": None,
        "decidable": "with two cameras",
    }
    (run / "metrics.json").write_text(json.dumps(metrics))
    text = " ".join("".join(Content(write_report(run, About("infer", [])).read_text(encoding="utf-8")).text).split())
    assert "one camera3 of 4the turnthe line of sight (to 72.1 mm, 1.06°)" in text
    assert "two cameras4 of 4nothingnothing" in text
    assert "with two cameras." in text
    assert "{'" not in text


def test_page_of_a_study(tmp_path: Path) -> None:
    (tmp_path / "default" / "0").mkdir(parents=True)
    (tmp_path / "default" / "0" / "report.html").write_text("")
    (tmp_path / "table.md").write_text(
        "| | human |\n|:--|---|\n| default | 95.0 |\n\nWords.\n\n| a |\n|---|\n| <b> |\n"
    )
    page = write_report(tmp_path, About("reproduce", [])).read_text(encoding="utf-8")
    content = Content(page)
    text = "".join(content.text)
    assert content.tags.count("table") == 2
    assert "95.0" in text
    assert "<b>" in text
    assert "default/0/report.html" in content.references
    assert "bokeh" not in page  # without plots, there is no need for it


def test_curves_are_those_of_the_top_associations(tmp_path: Path) -> None:
    lines = list(read_top_lines(write_run(tmp_path / "run") / "associations.jsonl"))
    assert [line["rank"] for line in lines] == [1] * FRAMES
    (own,) = curves_of(lines, {"p2p_sift": {"error_rows": ["p2p_sift.x", "p2p_sift.y"], "unit": "px"}})
    assert (own.name, own.unit, own.rows) == ("p2p_sift", "px", ("x", "y"))
    np.testing.assert_allclose(own.norm, 10.0 * np.arange(FRAMES - 1, -1, -1), atol=1e-9)
    assert np.isnan(own.goal_norm[:5]).all()
    np.testing.assert_allclose(own.goal_norm[5:], own.norm[5:])
    assert np.flatnonzero(own.switched).tolist() == [10]
    assert np.flatnonzero(~own.is_certain).tolist() == [10, 11]
    assert list(runs_of(own.state))[1] == (10, 11, "unsure")


def test_curves_of_frames_without_association() -> None:
    line = {"frame": 0, "time_s": 0.0, "kernel": "l2l", "descriptor": "lbd", "rank": 0, "confidence": 0.0, "error": []}
    (own,) = curves_of([line, {**line, "frame": 1, "rank": 1, "error": [3.0, 4.0], "confidence": 0.5}], {})
    assert own.rows == ("1", "2")
    assert np.isnan(own.norm[0])
    assert own.norm[1] == 5.0
    assert not own.is_certain.any()


def test_smoothing_is_a_running_mean() -> None:
    values = np.random.default_rng(0).normal(size=100)
    np.testing.assert_allclose(smoothed(values)[10], values[8:13].mean())
    np.testing.assert_allclose(smoothed(values)[0], values[:3].mean())
    assert len(smoothed(np.zeros(0))) == 0


@pytest.mark.slow
def test_page_of_a_long_video_takes_few_seconds(tmp_path: Path) -> None:
    """Five minutes at 30 Hz, ten ranks a frame."""
    run = write_run(tmp_path / "run")
    text = (run / "associations.jsonl").read_text()
    (run / "associations.jsonl").write_text(text * 300 + text.replace('"rank": 2', '"rank": 3') * 300)
    start = time.process_time()
    page = write_report(run, ABOUT)
    assert time.process_time() - start < 10
    assert page.stat().st_size < 10e6
