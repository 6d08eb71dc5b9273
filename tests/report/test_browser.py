"""The page in a headless browser: no errors, nothing fetched, selects change the plots, and it fits and prints."""

import json

import numpy as np
import pytest
import xarray as xr

from heliosweep.families.lookup import family_of_result
from tests.report.browser import BINARY, Browser
from tests.report.synthetic import BOTH, result
from tests.report.test_page import write_report

pytestmark = [
    pytest.mark.skipif(BINARY is None, reason="no chromium is installed"),
    # The browser writes to its folder until it is killed, and its pipes are closed by the interpreter.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

EVIL = "</script><script>document.title='evil'</script><!-- <img src=x onerror=\"document.title='evil'\"> @x{safe}"

#: Values of the first plot: of mirrors, pixels or lines.
DRAWN = """(() => {
  const models = Bokeh.documents.flatMap((one) => [...one._all_models.values()]);
  const renderers = models.filter((one) => one.type === 'GlyphRenderer');
  const sources = renderers.map((one) => one.data_source.data);
  const map = sources.find((one) => one.value);
  return Array.from(map ? map.value : sources.find((one) => one.image || one.text).image?.[0] ?? []);
})()"""


@pytest.fixture(scope="module")
def browser():
    with Browser() as one:
        yield one


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs")
    data = {
        "field": result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH}, heliostats=40, attrs={"title": EVIL}),
        "mirror": mirror(),
    }
    found = {}
    for name, one in data.items():
        (folder / name).mkdir()
        one.to_netcdf(folder / name / "result.nc", engine="netcdf4")
        found[name] = write_report(folder / name, family_of=family_of_result)
    return found


def mirror():
    """Slopes on a mirror and factors over dates, with words that would like to be markup."""
    rng = np.random.default_rng(3)
    dates = np.arange("2021-01-01", "2021-02-10", dtype="datetime64[D]").astype("datetime64[ns]")
    labels = {"method": ["LM", EVIL], "date": dates, "z": np.linspace(-1, 1, 30), "y": np.linspace(1, -1, 20)}
    attrs = {"units": "mrad", "long_name": f"slope {EVIL}"}
    slope = (("method", "z", "y"), rng.normal(size=(2, 30, 20)), attrs)
    return xr.Dataset(
        {"slope": slope, "factor": (("method", "date"), rng.normal(size=(2, 40)), attrs)}, labels, {"title": EVIL}
    )


def opened(browser, page, **how):
    """Open a page and wait until its plots are drawn."""
    browser.open(page, **how)
    browser.wait("Bokeh.documents.length > 0 && Bokeh.documents.every((one) => one.is_idle)")
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.parametrize("name", ["field", "mirror"])
@pytest.mark.parametrize(("width", "scheme"), [(400, "dark"), (1400, "light")])
def test_page_opens_without_errors_or_fetches_and_fits(browser, pages, name, width, scheme):
    opened(browser, pages[name], width=width, scheme=scheme)
    assert browser.errors == []
    assert browser.fetched == [pages[name].as_uri()]
    assert browser.run("document.documentElement.scrollWidth") == width
    assert browser.run("document.title") != "evil"
    paper = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
    if width == 1400:
        assert browser.run("document.documentElement.scrollHeight") <= 6 * 900
        headline = browser.run("document.querySelector('.numbers b').getBoundingClientRect().bottom")
        assert headline < 900  # on the first screen


def test_a_select_changes_the_map(browser, pages):
    data = result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH}, heliostats=40)["optical_efficiency"]
    opened(browser, pages["field"], width=1400)
    assert browser.run(DRAWN) == pytest.approx(100 * data.isel(latitude=1, tracking=0).to_numpy(), rel=1e-6)
    choose = f"""(() => {{
      const models = Bokeh.documents.flatMap((one) => [...one._all_models.values()]);
      models.find((one) => one.type === 'Select' && one.title === 'latitude').value = {json.dumps("2")};
    }})()"""
    browser.run(choose)
    chosen = 100 * data.isel(latitude=2, tracking=0).to_numpy()
    browser.wait(f"Math.abs({DRAWN}[0] - {chosen[0]}) < 1e-4")
    assert browser.run(DRAWN) == pytest.approx(chosen, rel=1e-6)


def test_a_printed_page_has_all_figures_and_no_controls(browser, pages):
    opened(browser, pages["field"], width=1000)
    browser.call("Emulation.setEmulatedMedia", media="print")
    assert browser.run("getComputedStyle(document.getElementById('explore')).display") == "none"
    assert browser.run("[...document.images].every((one) => one.complete && one.getBoundingClientRect().height > 100)")
    browser.call("Emulation.setEmulatedMedia", media="")
