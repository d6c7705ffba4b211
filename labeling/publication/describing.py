"""Writes `README.md` and `croissant.json` into a finished dataset."""

from __future__ import annotations

from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import claim, file_digest, replace_file, write_json
from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, Dataset
from isac_cosim.labeling.dataset.meta import META_FILE, Meta
from isac_cosim.labeling.dataset.shard import SCHEMA_VERSION
from isac_cosim.labeling.dataset.shard_index import INDEX_FILE
from isac_cosim.labeling.publication.card import MARK, README_FILE, readme
from isac_cosim.labeling.publication.croissant import CROISSANT_FILE, croissant
from isac_cosim.labeling.publication.statement import STATEMENT_FILE, Statement, read_statement


def write_descriptions(folder: Path, meta: Meta) -> None:
    """Write both files from a finished `dataset.json`, with what the folder states of its licence and citation.

    A README.md that somebody wrote stays. Raises InputError if that statement is damaged, OutputError.
    """
    statement = read_statement(folder)
    has_pull_outs = any((folder / DROPPED_PULL_OUTS).glob("*.parquet"))
    digests = {name: file_digest(folder / name) for name in (META_FILE, INDEX_FILE)}
    write_json(folder / CROISSANT_FILE, croissant(meta, statement, digests, has_pull_outs))
    card = folder / README_FILE
    if is_ours(card):
        text = readme(meta, statement, has_pull_outs)
        replace_file(card, lambda path: path.write_text(text, encoding="utf-8", newline="\n"))


def is_ours(card: Path) -> bool:
    """Return whether a README.md may be written: there is none, or it was made by this."""
    try:
        return MARK in card.read_text(encoding="utf-8")
    except FileNotFoundError:
        return True
    except (OSError, UnicodeDecodeError):
        return False


def describe(folder: Path, changes: Statement) -> tuple[Statement, bool]:
    """State the licence and the citation of a finished dataset, and write both files anew.

    changes: what is stated now; what it leaves open stays as it was. Returns what is stated in all, and whether
    README.md was written: one that somebody wrote stays. Raises InputError if the folder holds no finished dataset of
    the present schema, OutputError.
    """
    dataset = Dataset.open(folder)
    if dataset.meta.schema_version != SCHEMA_VERSION or dataset.meta.index_sha256 is None:
        raise InputError(
            f"{folder}: is of schema version {dataset.meta.schema_version}, and only version {SCHEMA_VERSION} can be "
            "described; generate it anew"
        )
    with claim(folder, META_FILE, "dataset"):
        stated = read_statement(folder).model_copy(update=changes.model_dump(exclude_none=True))
        write_json(folder / STATEMENT_FILE, stated.model_dump(mode="json"))
        write_descriptions(folder, dataset.meta)
    return stated, is_ours(folder / README_FILE)
