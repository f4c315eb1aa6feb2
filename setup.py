"""The README as a package index shows it: no picture or link that leads into a checkout.

Everything else is in pyproject.toml. With a ``Repository`` among ``project.urls`` pictures and links lead there;
without one a picture goes, and of a link its words stay.
"""

import re
import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent


def index_page(readme: str, repository: str | None) -> str:
    """Return a README without relative targets."""

    def replaced(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        if repository:
            return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/HEAD/{target})"
        return "" if picture else words

    return re.sub(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)]+)\)", replaced, readme)


if __name__ == "__main__":
    with (HERE / "pyproject.toml").open("rb") as file:
        urls = tomllib.load(file)["project"]["urls"]
    page = index_page((HERE / "README.md").read_text(encoding="utf-8"), urls.get("Repository"))
    setup(long_description=page, long_description_content_type="text/markdown")
