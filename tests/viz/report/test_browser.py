"""Tests of the page in headless Chromium: what is shown, and what happens when one clicks, seeks and plays."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from geoskill.viz.report.page import About, write_report
from tests.viz.report.report_runs import FRAMES, HOSTILE, RATE, write_run

pytestmark = pytest.mark.slow
ABOUT = About("infer", [("Again:", "python infer.py")])


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Debian's Chromium and its driver."""
    paths = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in paths:
        missing = "no Chromium; on Debian: apt-get install chromium chromium-driver"
        pytest.fail(missing) if os.environ.get("CI") else pytest.skip(missing)
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(paths[0])
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1400,1000"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(paths[1])))
    driver.set_script_timeout(60)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(write_run(tmp_path_factory.mktemp("page") / "run"), ABOUT)


@pytest.fixture
def opened(browser: Any) -> Callable[[Path], Any]:
    def open_page(path: Path) -> Any:
        browser.get(path.as_uri())
        until(browser, "window.Bokeh && Bokeh.documents.length > 0 && window.report")
        until(browser, "!document.getElementById('video') || document.getElementById('video').readyState >= 2")
        return browser

    return open_page


def until(browser: Any, condition: str) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 60).until(lambda driver: driver.execute_script(f"return Boolean({condition})"), condition)


def readout(browser: Any) -> list[str]:
    return [cell.text for cell in browser.find_elements("css selector", "#readout tbody td")]


def place(browser: Any) -> str:
    return str(browser.find_element("id", "place").text)


def cursors(browser: Any) -> list[float]:
    script = "return [0, 1].map(n => Bokeh.documents.map(d => d.get_model_by_name('cursor' + n)).find(m => m).location)"
    return [float(location) for location in browser.execute_script(script)]


def video_time(browser: Any) -> float:
    return float(browser.execute_script("return document.getElementById('video').currentTime"))


def test_page_loads_without_network_and_errors(opened: Callable[[Path], Any], page: Path) -> None:
    browser = opened(page)
    assert browser.title == "A thing is moved until one point comes onto another."
    assert [entry["message"] for entry in browser.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")] == []
    events = [entry["message"] for entry in browser.get_log("performance")]
    urls = [
        part.split('"')[0] for event in events if "requestWillBeSent" in event for part in event.split('"url":"')[1:]
    ]
    assert [url for url in urls if not url.startswith(("file:", "data:", "blob:"))] == []
    assert (place(browser), readout(browser)) == (
        "frame 0, 0.00 s",
        ["p2p_sift", "approaching", "290.0 px", "none", "50 %"],
    )


def test_button_shows_the_frame_where_it_is_seen_best(opened: Callable[[Path], Any], page: Path) -> None:
    browser = opened(page)
    browser.find_element("css selector", "button.seek").click()
    until(browser, "document.getElementById('place').textContent.startsWith('frame 12')")
    assert readout(browser) == ["p2p_sift", "approaching", "170.0 px", "170.0 px", "62 %"]
    assert cursors(browser) == pytest.approx([1.2, 1.2])
    assert video_time(browser) == pytest.approx(1.2, abs=0.01)
    # The picture of that frame, 8 * 12 bright.
    until(browser, "!document.getElementById('video').seeking")
    level = browser.execute_script(
        "const c = document.createElement('canvas').getContext('2d');"
        "c.drawImage(document.getElementById('video'), 0, 0); return c.getImageData(5, 5, 1, 1).data[0]"
    )
    assert level == pytest.approx(96, abs=6)


def test_slider_goes_frame_by_frame(opened: Callable[[Path], Any], page: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    browser = opened(page)
    slider = browser.find_element("id", "slider")
    slider.send_keys(Keys.HOME)
    for _ in range(10):
        slider.send_keys(Keys.ARROW_RIGHT)
    assert place(browser) == "frame 10, 1.00 s"
    assert readout(browser) == ["p2p_sift", "unsure, switched", "190.0 px (gate closed)", "190.0 px", "60 %"]
    slider.send_keys(Keys.END)
    assert place(browser) == f"frame {FRAMES - 1}, {(FRAMES - 1) / RATE:.2f} s"
    assert readout(browser)[1] == "at goal"


def test_click_in_a_plot_seeks(opened: Callable[[Path], Any], page: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser = opened(page)
    plot = browser.find_element("css selector", "#time .plots .bk-Figure")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
    moments = []
    for offset in (-0.2, 0.0, 0.2):
        ActionChains(browser).move_to_element_with_offset(plot, int(offset * plot.size["width"]), 30).click().perform()
        browser.execute_async_script("setTimeout(arguments[0], 500)")
        moments.append(browser.execute_script("return window.report.time"))
        assert cursors(browser) == pytest.approx([moments[-1]] * 2)
        until(browser, f"Math.abs(document.getElementById('video').currentTime - {moments[-1]}) < 0.02")
    assert 0.3 < moments[0] < moments[1] < moments[2] < 2.9
    assert moments[1] == pytest.approx(1.45, abs=0.35)


def test_cursors_move_with_the_video(opened: Callable[[Path], Any], page: Path) -> None:
    browser = opened(page)
    browser.execute_script("window.report.seek(0); document.getElementById('video').play()")
    until(browser, "document.getElementById('video').currentTime > 1")
    browser.execute_script("document.getElementById('video').pause()")
    browser.execute_async_script("setTimeout(arguments[0], 300)")
    assert cursors(browser) == pytest.approx([video_time(browser)] * 2, abs=0.25)
    assert place(browser) != "frame 0, 0.00 s"


def test_video_beside_the_page(opened: Callable[[Path], Any], tmp_path: Path) -> None:
    browser = opened(write_report(write_run(tmp_path / "run"), ABOUT, max_embedded_mb=1e-4))
    browser.execute_script("window.report.seek(2)")
    until(browser, "Math.abs(document.getElementById('video').currentTime - 2) < 0.02")
    assert browser.execute_script("return document.getElementById('video').src").endswith("/run/overlay.mp4")
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_hostile_names_run_nothing(opened: Callable[[Path], Any], tmp_path: Path) -> None:
    browser = opened(write_report(write_run(tmp_path / "run", HOSTILE), ABOUT))
    assert browser.execute_script("return typeof window.hacked") == "undefined"
    assert HOSTILE in browser.find_element("css selector", ".command").text


@pytest.mark.parametrize("width", [400, 1400])
def test_page_fits_the_window(opened: Callable[[Path], Any], page: Path, width: int) -> None:
    browser = opened(page)
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        until(browser, f"window.innerWidth === {width}")
        browser.execute_async_script("setTimeout(arguments[0], 500)")
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        video, plots = (browser.find_element("css selector", name).rect for name in ("#video", "#time .plots"))
        beside = plots["x"] > video["x"] + video["width"] - 1
        assert beside == (width == 1400)
        assert plots["width"] > 300
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
