"""The two distributions of the repository: one code writes the pages of both."""

from pathlib import Path
from typing import NamedTuple


class Package(NamedTuple):
    """A distribution, with README.md, docs/ and results/ in one folder."""

    name: str
    folder: Path
    texts: Path  # equations, figures and findings that its pages list
    extensions: tuple["Package", ...] = ()  # whose studies test statements of the paper too

    @property
    def reference(self) -> Path:
        """The committed results, one folder a study."""
        return self.folder / "results" / "reference"


ROOT = Path(__file__).parents[2]
EXTRAS = Package("critflow-extras", ROOT / "extras", ROOT / "extras" / "studies" / "pages.toml")
CRITFLOW = Package("critflow", ROOT, Path(__file__).with_name("pages.toml"), (EXTRAS,))
PACKAGES = tuple(package for package in (CRITFLOW, EXTRAS) if package.folder.is_dir())


def package_of(path: Path) -> Package:
    """The distribution to which a file of the repository belongs."""
    return EXTRAS if path.resolve().is_relative_to(EXTRAS.folder) else CRITFLOW
