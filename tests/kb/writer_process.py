"""A process that commits numbered outcomes until it is killed; prints each acknowledged one.

Run as ``python writer_process.py FOLDER``. Each commit is a blob and four statements that
stand or fall together.
"""

from __future__ import annotations

import sys
from pathlib import Path

import rtask


def main() -> None:
    """Write until killed."""
    with rtask.open(Path(sys.argv[1]), ontologies=False) as kb:
        number = kb.seq
        while True:
            number += 1
            with kb.transaction(agent="nao-1") as tx:
                outcome = f"urn:outcome:{number}"
                image = tx.blob(f"image {number}".encode(), "image/png")
                tx.add(outcome, "http://www.w3.org/1999/02/22-rdf-syntax-ns#type", image)
                tx.add(outcome, "urn:number", number)
                tx.add(outcome, "urn:image", image)
                if number > 1:
                    tx.remove("urn:last", "urn:is", number - 1)
                tx.add("urn:last", "urn:is", number)
            print(tx.commit.seq, number, flush=True)  # noqa: T201 - this is its report


if __name__ == "__main__":
    main()
