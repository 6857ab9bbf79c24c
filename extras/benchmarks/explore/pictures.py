"""Screenshots and a short animation of the page for the documents, from the real page in a headless Chromium.

python -m extras.benchmarks.explore.pictures [FOLDER]
"""

import asyncio
import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from critflow_extras.explore.server import Explorer, listening
from critflow_extras.explore.source import Random

from .chromium import Chromium, Tab

# Moduli and coefficients are shown; the counts need not be.
_SETTLED = (
    "window.shown === sequence && !waiting && !queue.length "
    "&& document.querySelector('tr[data-key=C_B]:not(.due)') !== null"
)
_READY = f"typeof sequence !== 'undefined' && {_SETTLED}"
# Width in pixels and quality of the animation, and milliseconds of a frame.
_WIDTH, _QUALITY, _FRAME = 720, 30, 110
# The part of the window that the animation shows.
_SHOWN = (0, 0, 1300, 1110)


async def taken(folder: Path) -> None:
    """Write explore.png, explore-narrow.png and explore.webp."""
    explorer = Explorer(Random(200, 4))
    server, address = listening(explorer)
    async with Chromium() as chromium:
        tab = await chromium.tab(address, width=1300, height=1110)
        await tab.until(_READY)
        frames = [await _frame(tab)]
        await _click(tab, 0.42, 0.5)
        for value in np.linspace(0, 2.4, 13)[1:]:
            await _slide(tab, "stress", value)
            frames.append(await _frame(tab))
        await tab.run("document.querySelector('input[value=face]').click()")
        await _click(tab, 0.7, 0.35)
        high = await tab.run("state.face.high")
        for part in np.sin(np.linspace(0, 1.5 * np.pi, 15))[1:]:
            await _slide(tab, "size", 0.9 * part * high if part > 0 else 0.5 * part * high)
            frames.append(await _frame(tab))
        for name in (5, 3, 2):
            await tab.run(f"get('populations').children[{name}].click()")
            await tab.until(_SETTLED, wait=60)
            frames += [await _frame(tab)] * 5
        for gamma in np.linspace(0, 0.1, 11)[1:]:
            await _slide(tab, "gamma", gamma)
            frames.append(await _frame(tab))
        frames += [frames[-1]] * 8
        frames[0].save(
            folder / "explore.webp", save_all=True, append_images=frames[1:], duration=_FRAME, loop=0, quality=_QUALITY
        )
        await _still(tab, folder)
    server.stop()
    explorer.close()


async def _still(tab: Tab, folder: Path) -> None:
    """The page with a picked face past the transition, in a wide and in a narrow window."""
    await tab.run("get('populations').children[5].click()")
    await tab.until(_SETTLED, wait=60)
    await _click(tab, 0.7, 0.35)
    for value in (0.02, 0.05, 0.08):
        await _slide(tab, "gamma", value)
    await tab.size(1300, 1190)
    await tab.until("!document.querySelector('tr.due')")
    (folder / "explore.png").write_bytes(_small(await tab.screenshot()))
    await tab.size(420, 1500)
    await tab.run("new Promise(r => setTimeout(r, 300))")
    (folder / "explore-narrow.png").write_bytes(_small(await tab.screenshot()))


async def _click(tab: Tab, right: float, down: float) -> None:
    """Click at a part of the width and height of the network."""
    left, top, width, height = await tab.run(
        "(() => { const r = get('network').getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; })()"
    )
    for kind in ("mousePressed", "mouseReleased"):
        await tab.mouse(kind, left + right * width, top + down * height)
    await tab.until(_SETTLED)


async def _slide(tab: Tab, name: str, value: float) -> None:
    await tab.run(f"(() => {{ const s = get('{name}'); s.value = {value}; s.dispatchEvent(new Event('input')); }})()")
    await tab.until(_SETTLED)


async def _frame(tab: Tab) -> Image.Image:
    shot = Image.open(io.BytesIO(await tab.screenshot())).convert("RGB").crop(_SHOWN)
    size = (_WIDTH, round(shot.height * _WIDTH / shot.width))
    return shot.resize(size, Image.Resampling.LANCZOS)


def _small(content: bytes) -> bytes:
    """The picture with a palette that keeps rare colours."""
    out = io.BytesIO()
    Image.open(io.BytesIO(content)).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3).save(
        out, "PNG", optimize=True
    )
    return out.getvalue()


if __name__ == "__main__":
    pictures = Path(__file__).parents[2] / "docs" / "pictures"
    asyncio.run(taken(Path(sys.argv[1]) if len(sys.argv) > 1 else pictures))
