"""Pages and files that live beside docs/ (README, CHANGELOG, results), and the links to them.

The pages are written to be read in the repository, too. So links that leave docs/ are turned here:
to a page of the site where there is one, to a copy of the file, or, for a folder, to its name.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
# Pages of the repository that are pages of the site.
PAGES = {"README.md": "overview.md", "CHANGELOG.md": "changelog.md"}
PAGES |= {"CONTRIBUTING.md": "contributing.md"}
LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\]]*\])*)\]\((?P<to>[^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```[^\S\n]*$)", re.MULTILINE | re.DOTALL)
PLAIN = {".md", ".json", ".csv", ".html", ".yaml", ".svg", ".png", ".txt"}


def source(src_uri: str) -> str:
    """Where in the repository a page of the site comes from."""
    back = {page: path for path, page in PAGES.items()}
    return back.get(src_uri, f"docs/{src_uri}")


def targets(text: str, src_uri: str) -> list[str]:
    """Files outside docs/ that a page links to, as paths in the repository."""
    found = (_path(match["to"], src_uri)[0] for match in LINK.finditer(text))
    return sorted({p for p in found if p and not p.startswith("docs/") and (ROOT / p).is_file()})


def copy_of(path: str) -> str:
    """Where the site keeps a file of the repository; what browsers would download is text."""
    return f"files/{path}" + ("" if Path(path).suffix in PLAIN - {".md"} else ".txt")


def on_files(files: Files, config: Any, **_: Any) -> Files:
    """Add the repository's pages, and every file that a page links to."""
    for path, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / path)))
    wanted = {
        path
        for file in files.documentation_pages()
        for path in targets(Path(str(file.abs_src_path)).read_text("utf-8"), file.src_uri)
        if file.abs_src_path
    }
    for path in sorted(wanted - set(PAGES)):
        files.append(File.generated(config, copy_of(path), abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn the links of a page; what stands in code stays."""
    src_uri = page.file.src_uri
    parts = FENCE.split(markdown)
    parts[::2] = [LINK.sub(lambda m: _turned(m, src_uri), part) for part in parts[::2]]
    return "".join(parts)


def _path(to: str, src_uri: str) -> tuple[str, str]:
    """The path in the repository that a link means, and its anchor; none for other links."""
    to, _, anchor = to.partition("#")
    if not to or "://" in to or to.startswith(("mailto:", "/")):
        return "", anchor
    return posixpath.normpath(posixpath.join(posixpath.dirname(source(src_uri)), to)), anchor


def _turned(match: re.Match[str], src_uri: str) -> str:
    path, anchor = _path(match["to"], src_uri)
    if not path or not (ROOT / path).exists():
        return match[0]  # if it is broken, mkdocs says so
    if path.startswith("docs/"):
        to = path.removeprefix("docs/")
    elif (ROOT / path).is_dir():
        named = match["text"].strip("`") == path
        return match["text"] if named else f"{match['text']} (`{path}`)"
    else:
        to = PAGES.get(path) or copy_of(path)
    to = posixpath.relpath(to, posixpath.dirname(src_uri) or ".")
    return f"{match['image']}[{match['text']}]({to}{'#' + anchor if anchor else ''})"
