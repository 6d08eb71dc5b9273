"""The page in a headless browser: nothing fails, switches change what is drawn, and everyone can read it."""

from __future__ import annotations

import csv
import itertools
import json

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.families.family import families, family_of_result
from heliosweep.report.index import write_index
from heliosweep.report.page import write_report
from heliosweep.runs.status import status_of
from tests.report.browser import BINARY, Browser
from tests.report.synthetic import BOTH, result

pytestmark = [
    pytest.mark.skipif(BINARY is None, reason="no chromium is installed"),
    pytest.mark.slow,
    # The browser writes to its folder until it is killed, and its pipes are closed by the interpreter.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

EVIL = (
    "</script><script>document.title='evil'</script><!-- \u2028 <img src=x onerror=\"document.title='evil'\"> @x{safe}"
)

#: Models of Bokeh by the names of their view and their own, and the numbers that each plot shows.
HELPERS = """(() => {
  window.figure = (view) => Bokeh.documents.flatMap((one) => one.roots()).find(({ id }) => id.startsWith(`${view}-`));
  window.model = (view, name) => figure(view).document.get_model_by_name(name);
  window.lines = (view) => figure(view).renderers.filter((one) => one.name?.startsWith('marks') && one.visible)
    .map(({ data_source }) => [Array.from(data_source.data.x), Array.from(data_source.data.y)]);
  window.drawn = () => [...document.querySelectorAll('figure.view')].map(({ id }) => {
    const data = model(id, 'source')?.data;
    return data ? Array.from(data.value || data.image[0]) : lines(id);
  });
})()"""

#: Colours of all canvases of one view.
PIXELS = """(() => {
  const all = [];
  const visit = (node) => {
    for (const one of node.querySelectorAll('*')) {
      if (one.shadowRoot) visit(one.shadowRoot);
      if (one.tagName === 'CANVAS' && one.width) all.push(one.toDataURL());
    }
  };
  visit(document.querySelector('#view-1 .plot'));
  return all.join();
})()"""


#: Colour of the upper left corner of the first plot, as it is painted.
CORNER = """(() => {
  const view = Bokeh.index.find_one(figure('view-1'));
  return [...view.canvas_view.primary.ctx.getImageData(2, 2, 1, 1).data];
})()"""


def corner(browser):
    browser.run("new Promise((done) => setTimeout(done, 300))")
    return browser.run(CORNER)


@pytest.fixture(scope="module")
def browser():
    with Browser() as one:
        yield one


def write(folder, data):
    folder.mkdir(exist_ok=True)
    data.to_netcdf(folder / "result.nc", engine="netcdf4")
    (folder / "study.resolved.yaml").write_text(f"title: {EVIL}\n", encoding="utf-8")
    return write_report(folder, family_of_result)


def mirror():
    """Slopes on a mirror, and spots on a receiver, with dates, words and numbers to switch."""
    rng = np.random.default_rng(3)
    sizes = {"method": 2, "date": 40, "receiver_height": 5, "z": 30, "y": 20}
    labels = {
        "method": ["LM", EVIL],
        "date": np.arange("2021-01-01", "2021-02-10", dtype="datetime64[D]").astype("datetime64[ns]"),
        "receiver_height": ("receiver_height", np.geomspace(1, 1000, 5), {"units": "m"}),
        "z": np.linspace(-1, 1, 30),
        "y": np.linspace(1, -1, 20),
    }

    def array(*dims):
        return dims, rng.normal(size=[sizes[dim] for dim in dims]), {"units": "mrad", "long_name": f"slope {EVIL}"}

    values = {"slope": array("method", "z", "y"), "factor": array("method", "date", "receiver_height")}
    values["other"] = array("receiver_height", "method")
    return xr.Dataset(values, labels, {"title": EVIL})


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs")
    field = result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH}, heliostats=40, attrs={"title": EVIL})
    return {"field": write(folder / "field", field), "mirror": write(folder / EVIL.replace("/", "_"), mirror())}


def opened(browser, page, **how):
    """Show a page and draw all its plots."""
    browser.open(page, **how)
    browser.run("dispatchEvent(new Event('beforeprint'))")
    browser.wait("[...document.querySelectorAll('figure.view')].every((view) => view.dataset.ready)")
    browser.run(HELPERS)
    return browser.run("drawn()")


def choose(browser, control, value):
    """Choose something as a reader would, and wait until it is drawn."""
    browser.run(
        f"(() => {{ const one = document.getElementById('{control}'); one.value = {json.dumps(str(value))};"
        "one.dispatchEvent(new Event('input', { bubbles: true })); })()"
    )
    browser.run(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 100))))"
    )


@pytest.mark.parametrize("name", ["field", "mirror"])
@pytest.mark.parametrize(("width", "scheme"), [(400, "dark"), (1600, "light")])
def test_page_opens_without_errors_or_fetches_and_fits(browser, pages, name, width, scheme):
    drawn = opened(browser, pages[name], width=width, scheme=scheme)
    assert drawn
    assert browser.errors == []
    assert browser.fetched == [pages[name].as_uri()]
    assert browser.run("document.documentElement.scrollWidth") == width
    assert browser.run("document.title") != "evil"
    paper = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
    assert corner(browser) == {"light": [255, 255, 255, 255], "dark": [21, 24, 28, 255]}[scheme]


def test_switches_of_a_map_change_what_is_drawn(browser, pages):
    data = result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH}, heliostats=40)
    drawn = opened(browser, pages["field"])[0]
    assert drawn == pytest.approx(100 * data["optical_efficiency"][0, 0].to_numpy(), rel=1e-6)
    seen = {browser.run(PIXELS)}
    for control, value, expected in (
        ("view-1-dim-latitude", 2, data["optical_efficiency"][2, 0]),
        ("view-1-dim-tracking", 1, data["optical_efficiency"][2, 1]),
        ("view-1-quantity", 2, data["shading_efficiency"][2, 1]),
        ("view-1-less", 1, data["shading_efficiency"][2, 1] - data["shading_efficiency"][2, 0]),
    ):
        choose(browser, control, value)
        drawn = browser.run("drawn()")[0]
        assert drawn == pytest.approx(100 * expected.to_numpy(), rel=1e-5, abs=1e-5)
        picture = browser.run(PIXELS)
        assert picture not in seen
        seen.add(picture)
    assert "less that of" in browser.run("document.querySelector('#view-1 .plot').getAttribute('aria-label')")
    assert browser.errors == []


def test_curves_run_along_what_is_chosen(browser, pages):
    data = mirror()
    opened(browser, pages["mirror"])
    along = "document.getElementById('view-2-along').value"
    assert browser.run(along) == "date"
    choose(browser, "view-2-along", "receiver_height")
    shown = browser.run("lines('view-2')")
    assert [x for x, _ in shown] == pytest.approx(np.log10(np.broadcast_to(np.geomspace(1, 1000, 5), (2, 5))))
    assert np.array([y for _, y in shown]) == pytest.approx(data["factor"][:, 0, :].to_numpy(), rel=1e-6)
    axes = "figure('view-2').below.filter((one) => one.visible).map((one) => one.axis_label)"
    assert browser.run(axes) == ["receiver height\N{NO-BREAK SPACE}(m)"]
    choose(browser, "view-2-lines", "")
    choose(browser, "view-2-dim-date", 7)
    (line,) = browser.run("lines('view-2')")
    assert line[1] == pytest.approx(data["factor"][0, 7].to_numpy(), rel=1e-6)
    choose(browser, "view-2-quantity", 1)
    assert browser.run("document.getElementById('view-2-dim-date').closest('.switch').hidden")
    choose(browser, "view-2-quantity", 0)
    assert browser.run(along) == "receiver_height"
    assert browser.errors == []


def test_pictures_lie_the_right_way_round(browser, pages):
    data = mirror()
    drawn = opened(browser, pages["mirror"])[0]
    # The first row of an image is the lowest; to the right means larger, whatever the order in the file.
    assert np.reshape(drawn, (30, 20)) == pytest.approx(data["slope"][0, :, ::-1].to_numpy(), rel=1e-5)


def test_a_box_hides_a_line(browser, pages):
    opened(browser, pages["mirror"])
    assert len(browser.run("lines('view-2')")) == 2
    assert browser.run("model('view-2', 'path-1').visible")
    boxes = "document.querySelectorAll('#view-2 .keys:not([hidden]) input')"
    browser.run(f"{boxes}[1].focus()")
    browser.press(" ", 32)
    assert len(browser.run("lines('view-2')")) == 1
    assert not browser.run("model('view-2', 'path-1').visible")
    browser.run(f"{boxes}[0].click()")
    assert "no value" in browser.run("document.querySelector('#view-2 .said').textContent")
    assert browser.errors == []


def test_plots_follow_the_scheme_without_a_reload(browser, pages):
    opened(browser, pages["field"], scheme="light")
    light = browser.run(PIXELS)
    browser.scheme("dark")
    assert corner(browser) == [21, 24, 28, 255]
    assert browser.run(PIXELS) != light
    assert browser.run("model('view-1', 'bar').title_text_color") == "rgb(228, 232, 236)"
    assert browser.errors == []


def test_keyboard_reaches_and_moves_everything(browser, pages):
    opened(browser, pages["field"])
    browser.run("document.getElementById('view-1-dim-latitude').focus()")
    browser.press("ArrowDown", 40)
    browser.wait("document.querySelector('#view-1 .said').textContent.startsWith('latitude 15')")
    browser.run("document.querySelector('#view-1 .plot').focus()")
    start = "figure('view-1').x_range.start"
    browser.press("0", 48)
    before = browser.run(start)
    browser.press("ArrowRight", 39)
    moved = browser.run(start)
    assert moved > before
    browser.press("+", 187)
    assert browser.run(start) > moved
    browser.press("0", 48)
    browser.wait(f"{start} === {before}")


def test_controls_have_labels_and_headings_an_order(browser, pages):
    for page in pages.values():
        opened(browser, page)
        unlabelled = "[...document.querySelectorAll('select, input')].filter((one) => !one.labels.length).length"
        assert browser.run(unlabelled) == 0
        assert browser.run("document.querySelectorAll('select, input').length") >= 4
        nameless = (
            "[...document.querySelectorAll('button, a, summary')].filter((one) => !one.textContent.trim()).length"
        )
        assert browser.run(nameless) == 0
        assert browser.run("[...document.querySelectorAll('img')].every((one) => one.alt)")
        levels = browser.run("[...document.querySelectorAll('h1, h2, h3, h4')].map((one) => +one.tagName[1])")
        assert levels[0] == 1
        assert levels.count(1) == 1
        assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
        identifiers = browser.run("[...document.querySelectorAll('[id]')].map((one) => one.id)")
        assert len(identifiers) == len(set(identifiers))
        said = browser.run("[...document.querySelectorAll('.view .plot')].map((one) => one.getAttribute('aria-label'))")
        assert all(said)


def test_values_can_be_read_as_a_table(browser, pages):
    opened(browser, pages["field"])
    browser.run("document.querySelector('#view-1 details').open = true")
    browser.wait("document.querySelectorAll('#view-1 table tbody tr').length === 40")
    cell = "document.querySelector('#view-1 tbody td:last-child').textContent"
    before = browser.run(cell)
    choose(browser, "view-1-dim-latitude", 1)
    assert browser.run(cell) != before


def test_hovering_tells_the_value(browser, pages):
    opened(browser, pages["field"])
    browser.run("document.querySelector('#view-1 .plot').scrollIntoView()")
    place = browser.run("""(() => {
      const source = model('view-1', 'source');
      const view = Bokeh.index.find_one(figure('view-1'));
      const box = view.canvas_view.el.getBoundingClientRect();
      const { x_scale, y_scale } = view.frame;
      return [box.x + x_scale.compute(source.data.x[3]), box.y + y_scale.compute(source.data.y[3])];
    })()""")
    for far in (25, 0):
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=place[0] - far, y=place[1])
    browser.wait("""(() => {
      const tips = [...document.querySelectorAll('.bk-Tooltip')].map((tip) => tip.shadowRoot);
      return tips.some((tip) => tip.textContent.includes(model('view-1', 'source').data.text[3]));
    })()""")


def test_print_shows_every_plot(browser, pages):
    browser.open(pages["field"], height=300)
    browser.run("window.dispatchEvent(new Event('beforeprint'))")
    browser.wait("[...document.querySelectorAll('figure.view')].every((view) => view.dataset.ready)")
    assert len(browser.call("Page.printToPDF")["data"]) > 10_000


def test_a_figure_wider_than_the_screen_shows_that_it_goes_on(browser, pages):
    opened(browser, pages["field"], width=400)
    shadows = """[...document.querySelectorAll(".picture")].filter((one) => one.scrollWidth > one.clientWidth)
      .map((one) => [getComputedStyle(one).backgroundImage.split("linear-gradient").length - 1,
                     getComputedStyle(one.querySelector("img")).mixBlendMode])"""
    found = browser.run(shadows)
    assert found
    assert all(one == [4, "multiply"] for one in found)  # else the figure would cover them


def test_list_of_all_studies(browser, pages):
    index = write_index(pages["field"].parent.parent, status_of)
    for width in (400, 1600):
        browser.open(index, width=width, scheme="dark")
        assert browser.errors == []
        assert browser.fetched == [index.as_uri()]
        assert browser.run("document.documentElement.scrollWidth") == width
    links = browser.run("[...document.querySelectorAll('a')].map((one) => one.href)")
    assert sorted(links) == sorted(page.as_uri() for page in pages.values())
    assert EVIL in browser.run("document.querySelector('main').textContent")


def test_a_plot_can_be_saved(browser, pages, tmp_path):
    opened(browser, pages["field"])
    browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    browser.run("void figure('view-1').toolbar.tools.find((one) => one.type === 'SaveTool').do.emit()")
    for _ in range(100):
        browser.run("new Promise((done) => setTimeout(done, 100))")
        if found := list(tmp_path.glob("*.png")):
            break
    assert found[0].read_bytes().startswith(b"\x89PNG")
    assert browser.errors == []


def test_titles_of_axes_and_bars_fit_their_frame(browser, tmp_path):
    data = result({"latitude": [0.0, 15.0, 30.0]}, heliostats=40)
    long = "place on the mirror, to the right as seen from the target, " * 4 + "x" * 80
    for name in ("optical_efficiency", "field_optical_efficiency", "latitude"):
        data[name].attrs["long_name"] = long if name != "latitude" else long.replace(",", "")
    page = write(tmp_path, data)
    for width in (400, 1200):
        opened(browser, page, width=width)
        browser.run("new Promise((done) => setTimeout(done, 300))")
        found = browser.run("""['view-1', 'view-2'].map((view) => {
          const [{ below, left }, bar] = [figure(view), model(view, 'bar')];
          const { width, height } = Bokeh.index.find_one(figure(view)).frame.bbox;
          const pen = document.createElement('canvas').getContext('2d');
          pen.font = '13px system-ui, sans-serif';
          const size = (words) => Math.max(...words.split('\\n').map((line) => pen.measureText(line).width));
          const [x, y] = [below.find((one) => one.visible).axis_label, left[0].axis_label];
          return { over: [size(x) - width, size(y) - height, size(bar ? bar.title : '') - width],
            lines: [x, y, bar ? bar.title : ''].map((words) => words.split('\\n').length) };
        })""")
        assert max(over for one in found for over in one["over"]) <= 0
        assert {max(one["lines"]) for one in found} == {4}
        assert browser.errors == []


def test_keys_show_dashes_and_categories_are_not_joined(browser, tmp_path):
    labels = {"method": ["A", "B", "C"], "hour": [9.0, 12.0, 15.0], "module": [1, 2, 3, 4]}
    values = np.random.default_rng(1).normal(size=(3, 3, 4))
    about = {"long_name": "slope"}
    data = xr.Dataset({"a": (("method", "hour"), values[..., 0], about), "b": (tuple(labels), values)}, labels)
    page = write(tmp_path, data)
    opened(browser, page)
    keys = "[...document.querySelectorAll('.keys:not([hidden]) path')].filter((one) => one.checkVisibility())"
    dashes = browser.run(f"{keys}.map((one) => one.getAttribute('stroke-dasharray'))")
    drawn = browser.run("[0, 1, 2].map((i) => [...model('view-1', `path-${i}`).glyph.line_dash.value].join(' '))")
    assert dashes == [None, "6 3", "2 2"]
    assert drawn == ["", "6 3", "2 2"]
    heading = "document.querySelector('#view-1 h3').textContent"
    assert browser.run(heading) == "Slope over hour"
    choose(browser, "view-1-quantity", 1)
    assert browser.run("model('view-1', 'path-0').visible")
    choose(browser, "view-1-along", "module")
    assert browser.run(heading) == "B over module"
    assert not browser.run("[0, 1, 2].some((i) => model('view-1', `path-${i}`).visible)")
    assert len(browser.run("lines('view-1')")) == 3
    assert browser.run(f"{keys}.every((one) => one.classList.contains('mark'))")
    assert browser.errors == []


@pytest.fixture(scope="module", params=list(families()))
def example(request, tmp_path_factory):
    """Page of a family's example."""
    folder = tmp_path_factory.mktemp("example")
    (folder / "study.yaml").write_text(families()[request.param].example(), encoding="utf-8")
    found = api.run(api.load(folder / "study.yaml"), folder / "result")
    return found.folder / "report.html"


def test_every_plot_of_a_family_is_drawn_whatever_is_chosen(browser, example):
    opened(browser, example, width=400)
    assert browser.run("document.documentElement.scrollWidth") == 400
    controls = browser.run("[...document.querySelectorAll('.switch select, .switch input')].map((one) => one.id)")
    assert controls
    for control in controls:
        found = f"document.getElementById('{control}')"
        if browser.run(f"{found}.type") == "range":
            values = browser.run(f"[{found}.min, {found}.max]")
        else:
            values = browser.run(f"[...{found}.options].filter((one) => !one.disabled).map((one) => one.value)")
        for value in values[-3:]:
            choose(browser, control, value)
    browser.run("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    browser.wait("[...document.querySelectorAll('.values')].every((one) => one.querySelector('tbody td'))")
    assert browser.run("document.documentElement.scrollWidth") == 400
    assert browser.errors == []


def test_points_are_sorted_filtered_and_saved(browser, pages, tmp_path):
    opened(browser, pages["field"])
    column = "[...document.querySelectorAll('.ranked tbody tr:not([hidden])')].map((row) => {}(row.cells[0]))"
    numbers = column.format("((cell) => Number(cell.dataset.value))")
    assert len(browser.run(numbers)) == 6
    browser.run("document.querySelector('.ranked th button').click()")
    assert browser.run(numbers) == [30, 30, 15, 15, 0, 0]
    browser.run("document.querySelector('.ranked th button').click()")
    assert browser.run(numbers) == [0, 0, 15, 15, 30, 30]
    assert browser.run("document.querySelector('.ranked th').getAttribute('aria-sort')") == "ascending"
    write = "((one, text) => { one.value = text; one.dispatchEvent(new Event('input')); })"
    for text, left in (("> 10", 4), ("10 .. 20", 2), ("<= 0", 2), ("7", 0), ("", 6)):
        browser.run(f"{write}(document.querySelector('.ranked .filters input'), {json.dumps(text)})")
        assert len(browser.run(numbers)) == left
    browser.run(f"{write}(document.querySelectorAll('.ranked .filters input')[1], 'SPINNING')")
    assert browser.run("document.querySelector('.ranked .said').textContent") == "3 of 6 rows"
    browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    browser.run("document.querySelector('.ranked .save').click()")
    for _ in range(100):
        browser.run("new Promise((done) => setTimeout(done, 100))")
        if found := list(tmp_path.glob("*.csv")):
            break
    header, *rows = csv.reader(found[0].read_text(encoding="utf-8").splitlines())
    assert header[0].startswith("latitude")
    assert [row[:2] for row in rows] == [[latitude, "spinning-elevation"] for latitude in ("0.0", "15.0", "30.0")]
    assert float(rows[0][2]) > 1  # in percent, in full
    assert browser.errors == []
