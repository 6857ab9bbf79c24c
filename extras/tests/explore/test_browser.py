"""The page in a real Chromium: what it shows, what the mouse changes, its lines, theme and strain."""

import asyncio
import json

import pytest

from benchmarks.explore.chromium import Chromium, executable
from critflow import strain_path, upper_bound
from critflow_extras.explore import numbers, session, view
from critflow_extras.explore.server import Explorer, listening
from critflow_extras.explore.source import Random

pytestmark = pytest.mark.skipif(executable() is None, reason="no Chromium: install the package chromium")
# All numbers are shown, and nothing waits.
SETTLED = (
    "typeof sequence !== 'undefined' && window.shown === sequence && !waiting && !queue.length "
    "&& !document.querySelector('tr.due')"
)


ROWS = "[...document.querySelectorAll('#numbers tr')]"


class Browser:
    """A server and a browser."""

    def __init__(self):
        self.explorer, self.chromium = Explorer(Random(64, 3)), Chromium()

    async def start(self):
        self.server, self.address = listening(self.explorer)
        await self.chromium.__aenter__()

    async def stop(self):
        await self.chromium.__aexit__(None, None, None)
        self.server.stop()
        while self.explorer.open_tabs:
            await asyncio.sleep(0.01)
        self.explorer.close()

    async def tab(self, **size):
        tab = await self.chromium.tab(self.address, **size)
        await tab.until(SETTLED)
        return tab

    async def page_of(self, tab):
        return self.explorer.pages[await tab.run("welcome.tab")]


@pytest.fixture(scope="module")
def browser(loop):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view, "WAITS", (0.0, 0.02, 0.0))
        browser = Browser()
        loop.run(browser.start())
        yield browser
        loop.run(browser.stop())


async def texts(tab):
    """All digits of the values by the key of the number."""
    return dict(await tab.run(f"{ROWS}.map(row => [row.dataset.key, row.querySelector('button').dataset.text])"))


def with_minus(texts):
    """Numbers as the page draws them; a click copies them with hyphens."""
    return {key: text.replace("-", "−") for key, text in texts.items()}


async def slide(tab, name, value):
    await tab.run(f"(() => {{ const i = get('{name}'); i.value = {value}; i.dispatchEvent(new Event('input')); }})()")
    await tab.until(SETTLED)


async def place(tab, name="network"):
    box = f"(() => {{ const r = get('{name}').getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; }})()"
    left, top, width, height = await tab.run(box)
    return left + 0.45 * width, top + 0.4 * height


async def pixels(tab):
    return await tab.run("get('network').toDataURL()")


async def test_the_page_shows_the_numbers_of_the_state(browser):
    tab = await browser.tab()
    await tab.run("send({do: 'select', edge: 5})")
    await tab.until(SETTLED)
    await slide(tab, "stress", 0.75)
    state = (await browser.page_of(tab)).session.state
    rows = [*numbers.precise(state.model.manifold, state.critical), *numbers.variances(state.critical)]
    expected = {row.key: row.text for row in [*rows, *numbers.counts(state.critical)]}
    shown = await texts(tab)
    assert expected.items() <= shown.items() and len(expected) == 9
    assert shown["bound"] == f"{upper_bound(state.model.network, 'B_0'):.14f}"
    assert shown["residual"] == f"{state.critical.residual:.6g}"
    visible = f"{ROWS}.map(row => [row.dataset.key, row.cells[1].textContent])"
    short = {row.key: row.short for row in rows}
    assert with_minus(short).items() <= dict(await tab.run(visible)).items() and with_minus(short) != short
    await tab.run("window.copied = []; navigator.clipboard.writeText = async words => copied.push(words)")
    await tab.run(f"{ROWS}.find(row => row.dataset.key === 'B_0').querySelector('button').click()")
    assert await tab.until("copied[0]") == expected["B_0"] != short["B_0"]
    await tab.until(f"get('sentence').textContent.includes('{expected['B_0']} is copied')")
    await tab.run("get('all').click()")
    assert dict(await tab.run(visible)) == with_minus(shown)
    words = "['-0.5', '2 at -.5', '1e-12', 'edge-1', '3-50', '--pins hull', 'γ (-1)']"
    assert await tab.run(f"{words}.map(minus)") == "−0.5,2 at −.5,1e−12,edge-1,3-50,--pins hull,γ (−1)".split(",")
    assert tab.problems == []


async def test_the_mouse_changes_edges_and_faces(browser):
    tab = await browser.tab()
    x, y = await place(tab)
    first = await pixels(tab)
    await tab.mouse("mousePressed", x, y)
    await tab.until(SETTLED)
    for step in range(1, 6):
        await tab.mouse("mouseMoved", x, y - 12 * step)
    await tab.mouse("mouseReleased", x, y - 60)
    await tab.until(SETTLED)
    page = await browser.page_of(tab)
    assert page.session.state.change[0] == "edge" and page.session.state.change[2] > 0.5
    raised, before = await pixels(tab), (await texts(tab))["B_0"]
    assert raised != first
    await tab.run("document.querySelector('input[value=face]').click()")
    await tab.mouse("mousePressed", x + 40, y + 30)
    await tab.mouse("mouseReleased", x + 40, y + 30)
    await tab.until(SETTLED)
    for _ in range(3):
        await tab.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp")
    await tab.until(SETTLED)
    assert page.session.state.change[0] == "face"
    assert (await texts(tab))["B_0"] == before and await pixels(tab) != raised
    await tab.send("Input.dispatchKeyEvent", type="keyDown", key="z", modifiers=2)
    await tab.until(SETTLED)
    assert page.session.state.change[0] == "edge"
    await tab.run("get('populations').children[2].click()")
    await tab.until(SETTLED)
    found = await texts(tab)
    assert found["B_0"][:14] == found["bound"][:14]
    await slide(tab, "gamma", 0.02)
    assert "B(γ)" in await texts(tab) and not await tab.run("get('curvebox').hidden")
    assert tab.problems == []


LINE = """(() => {{
  const image = new ImageData(60, 60), view = {{s: 2, x0: 5, y0: 50}};
  new Uint32Array(image.data.buffer).fill(0xffffffff);
  rasterise(image, Float32Array.from([{line}]), 0, 1, view, [0, 0, 0], {thickness}, {dash});
  let sum = 0; for (let i = 0; i < image.data.length; i += 4) sum += 1 - image.data[i] / 255;
  return sum;
}})()"""
LINES = {
    "flat": ("2, 3, 22, 3", 2.5, 0, 40 * 2.5),
    "steep, backwards": ("10, 21, 4, 1", 3.0, 0, 2 * 436**0.5 * 3.0),
    "diagonal, thin": ("1, 1, 21, 21", 0.4, 0, 2 * 800**0.5 * 0.4),
    "dashed": ("1, 1, 19, 25", 2.0, 4, 60 * 2.0 * 2 / 3),
    "beyond the edge": ("-100, 5, 100, 5", 2.0, 0, 60 * 2.0),
}


async def test_pixels_cover_the_area_of_a_line(browser):
    tab = await browser.tab()
    for name, (line, thickness, dash, area) in LINES.items():
        covered = await tab.run(LINE.format(line=line, thickness=thickness, dash=dash))
        assert covered == pytest.approx(area, rel=0.04), name


async def test_a_narrow_window_and_names_of_all_controls(browser):
    tab = await browser.tab(width=360, height=700)
    assert await tab.run("document.documentElement.scrollWidth") <= 360
    unnamed = (
        "[...document.querySelectorAll('input,select,canvas[tabindex],button')].filter(e => "
        "!(e.labels && e.labels.length) && !e.ariaLabel && !e.textContent.trim()).map(e => e.id)"
    )
    assert await tab.run(unnamed) == []


async def test_a_file_is_opened_with_its_cell_and_the_answer_is_in_view(browser):
    """A refusal below the window is read above it, and is answered in a field, without another choice of the file."""
    tab = await browser.tab(width=420, height=700)
    nodes = [{"id": 3 * i + j, "x": i, "y": j} for i in range(3) for j in range(3)]
    ends = [(3 * i + j, end) for i in range(3) for j in range(3) for end in ((3 * i + 3) % 9 + j, 3 * i + (j + 1) % 3)]
    links = [{"source": a, "target": b} for a, b in ends]
    choice = {"name": "mine.json", "text": json.dumps({"nodes": nodes, "links": links})}
    await tab.run("get('file').scrollIntoView()")
    await tab.run(
        f"(() => {{ const c = {json.dumps(choice)}, t = new DataTransfer(); t.items.add(new File([c.text], c.name)); "
        "get('file').files = t.files; get('file').onchange(); })()"
    )
    await tab.until("get('sentence').className === 'error' && get('sentence').textContent.includes('field')")
    seen = "(() => { const r = get('sentence').getBoundingClientRect(); return [r.top, r.bottom]; })()"
    top, bottom = await tab.run(seen)
    assert 0 <= top < bottom <= 700 and await tab.run("scrollY") > 700
    await tab.run("get('cell').value = '3 3'; get('again').click()")
    await tab.until(f"get('sentence').textContent.startsWith('mine.json is open') && {SETTLED}")
    assert (await browser.page_of(tab)).session.state.model.network.cell.tolist() == [[3, 0], [0, 3]]
    assert tab.problems == []


async def test_a_page_without_its_token_says_what_it_needs(browser):
    for end in ("#", "#wrong token", f"?token={browser.explorer.connections.token}"):
        tab = await browser.chromium.tab(browser.address.partition("#")[0] + end)
        await tab.until("document.body && document.body.innerText.includes('the link that critflow explore')")
        assert tab.problems == [] and await tab.run("socket === undefined")


# The least contrast of the text on the page with what is behind it, by the formula of WCAG 2, and the text.
CONTRAST = """(() => {
  const parse = (words) => (words.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const found = parse(getComputedStyle(e).backgroundColor);
      if (found.length === 3 || found[3] > 0) return found;
    }
  };
  const found = [];
  for (const e of document.querySelectorAll('body *')) {
    const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own || e.matches('script, option') || !e.getClientRects().length) continue;
    const [a, b] = [light(parse(getComputedStyle(e).color)), light(behind(e))].sort((x, y) => y - x);
    found.push([(a + 0.05) / (b + 0.05), e.textContent.trim()]);
  }
  return found.sort((x, y) => x[0] - y[0])[0];
})()"""
# The red of most pixels of the network: that of the paper.
PAPER = """(() => {
  const canvas = get('network'), counts = new Array(256).fill(0);
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  for (let i = 0; i < data.length; i += 4) counts[data[i]]++;
  return counts.indexOf(Math.max(...counts));
})()"""


async def choose(tab, name, value):
    await tab.run(f"(() => {{ const i = get('{name}'); i.value = '{value}'; i.onchange(); }})()")
    await tab.until(SETTLED)


async def test_the_theme_of_the_browser_leaves_every_text_its_contrast(browser):
    tab = await browser.tab()
    for theme, paper in (("light", 255), ("dark", 22)):
        feature = {"name": "prefers-color-scheme", "value": theme}
        await tab.send("Emulation.setEmulatedMedia", features=[feature])
        await tab.until(f"{PAPER} === {paper} && theme === '{theme}'")
        least, words = await tab.run(CONTRAST)
        assert least >= 4.5, words
    # The browser is dark now; what is chosen stays.
    await choose(tab, "theme", "light")
    assert await tab.run(PAPER) == 255
    assert tab.problems == []


# The largest number of messages under way, from here on.
WATCHED = """(() => {
  window.most = 0; window.sent = 0; let open = 0; const original = socket.send.bind(socket);
  socket.send = (words) => { sent++; most = Math.max(most, ++open); original(words); };
  const last = window.painted;
  window.painted = (header) => { open--; last(header); };
})()"""


async def test_play_moves_the_strain_forth_and_back_and_computes_each_state_once(browser, monkeypatch):
    computed = []
    monkeypatch.setattr(session, "strain_path", lambda *a, **k: computed.append((a[1], k)) or strain_path(*a, **k))

    def energies():
        return [strains for strains, options in computed if options["measure"] == "energy"]

    tab = await browser.tab()
    await tab.run(WATCHED)
    await tab.run("get('play').click()")
    await tab.until("sent >= 55 && !player.forward", wait=60)
    assert len(energies()) == 50
    await tab.until("sent >= 110 && player.forward", wait=60)
    assert len(energies()) == 50 and await tab.run("most") == 1
    await tab.run("get('play').click()")
    await tab.until(SETTLED)
    stopped = await tab.run("sent")
    assert await tab.run("player") is None and 0 < await tab.run("+get('gamma').value") < 0.1
    await asyncio.sleep(0.2)
    assert await tab.run("sent") == stopped
    # Every other change ends it too, and one sign of a shear loosens this network.
    await choose(tab, "deformation", "simple_shear")
    await tab.run("get('play').click()")
    await tab.until("player.turned && player.step >= 4", wait=60)
    assert await tab.run("most") == 1
    await tab.run("send({do: 'select', edge: 5})")
    await tab.until(SETTLED)
    assert await tab.run("player") is None and tab.problems == []
