"""Each notebook as a page: text as it is, code as blocks, and a link to the file itself."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

# A link to a notebook is one to its page; the files' own link says "download".
LINK = re.compile(r"(?<!\[Download this notebook\])\((?P<path>[\w./]*)\.ipynb\)")


def on_files(files: Files, config: Any, **_: Any) -> Files:
    """Add the pages."""
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        text = Path(str(file.abs_src_path)).read_text(encoding="utf-8")
        uri = file.src_uri.removesuffix(".ipynb") + ".md"
        files.append(File.generated(config, uri, content=_page(json.loads(text), file.name)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Turn the links to notebooks."""
    return LINK.sub(r"(\g<path>.md)", markdown)


def _page(notebook: Any, name: str) -> str:
    title, *cells = map(_cell, notebook["cells"])
    return "\n\n".join([title, f"[Download this notebook]({name}.ipynb) for Jupyter.", *cells])


def _cell(cell: Any) -> str:
    text = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return text
    language = "sh" if text.startswith("!") else "python"
    return f"```{language}\n{text.removeprefix('!')}\n```"
