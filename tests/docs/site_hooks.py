"""What the site needs beside the pages: the command reference, and code blocks without our marks.

mkdocs calls these functions by name (``hooks`` in mkdocs.yml).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

_MARK = re.compile(r"^```(\w+) no-run$", re.M)
_REFERENCE = "cli.md"


def on_files(files: Any, config: Any) -> Any:
    """Add the page of the command line, written from the help of the commands."""
    from mkdocs.structure.files import File

    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    from tests.docs.command_reference import reference

    if files.get_file_from_path(_REFERENCE) is None:
        files.append(File.generated(config, _REFERENCE, content=reference()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Drop the mark of code blocks that the tests do not run; mkdocs reads it as text."""
    return _MARK.sub(r"```\1", markdown)
