"""`README.md` of a dataset: what is in it, with the front matter that Hugging Face `datasets` reads."""

from __future__ import annotations

import html
import json
from collections.abc import Iterator

import numpy as np
import pyarrow as pa

from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, ROADS, SHARDS
from isac_cosim.labeling.dataset.meta import META_FILE, Meta
from isac_cosim.labeling.dataset.shard import schema
from isac_cosim.labeling.publication.columns import COLUMNS
from isac_cosim.labeling.publication.statement import Statement

README_FILE = "README.md"
MARK = f"<!-- Made from {META_FILE}; `cosim describe` makes it anew. -->"
"""By this line a README.md is known as made, and is replaced; one without it is somebody's own."""
MOST_SCENARIOS = 20
"""Scenarios whose names are listed."""


def title_of(meta: Meta) -> str:
    """Return what a dataset is called: after its scenarios, and the digest of what made it."""
    names = [scenario.name for scenario in meta.scenarios]
    of = "-".join(names) if len(names) <= 2 else f"{names[0]}-and-{len(names) - 1}-more"
    return f"driver-intentions-{of}-{meta.fingerprint[:8]}"


def summary_of(meta: Meta) -> str:
    """Return a dataset in two sentences."""
    samples = f"{meta.samples} sample{'' if meta.samples == 1 else 's'}"
    return (
        f"{samples} of driver intentions, each with {meta.duration_s:g} s of states: of a target vehicle as it was "
        f"sensed and as it truly drove ({meta.tv_rate_hz:g} Hz), and of an own vehicle near it as it reports them "
        f"({meta.uv_rate_hz:g} Hz). Labels come from observed motion. Split by seed, never by sample."
    )


def readme(meta: Meta, statement: Statement, has_pull_outs: bool) -> str:
    """Return the text of README.md. has_pull_outs: whether the dataset keeps dropped pull-outs."""
    return "\n".join([*_front_matter(meta, statement, has_pull_outs), *_body(meta, statement, has_pull_outs), ""])


def _front_matter(meta: Meta, statement: Statement, has_pull_outs: bool) -> Iterator[str]:
    """Yield the lines that Hugging Face reads. Texts are in JSON, which YAML understands."""
    configs = {"samples": SHARDS, **({"pull_outs": DROPPED_PULL_OUTS} if has_pull_outs else {}), "roads": ROADS}
    yield "---"
    yield f"pretty_name: {json.dumps(title_of(meta))}"
    if statement.license is not None:
        yield f"license: {json.dumps(statement.license.lower())}"
    yield "configs:"
    for name, folder in configs.items():
        yield f"- config_name: {name}"
        yield f'  data_files: "{folder}/*.parquet"'
        if name == "samples":
            yield "  default: true"
    yield "---"


def _body(meta: Meta, statement: Statement, has_pull_outs: bool) -> Iterator[str]:
    yield f"{MARK}\n\n# {title_of(meta)}\n\n{summary_of(meta)}\n"
    names = [scenario.name for scenario in meta.scenarios]
    more = f" and {len(names) - MOST_SCENARIOS} more" if len(names) > MOST_SCENARIOS else ""
    yield f"Scenarios: {', '.join(names[:MOST_SCENARIOS])}{more}."
    yield f"Episodes, each a scenario and a seed: {len(meta.shards)}.\n"
    yield "| intention | samples |\n| --- | --- |"
    for intention, number in meta.by_intention().items():
        yield f"| {intention} | {number} |"
    origins = ", ".join(f"{number} {origin}" for origin, number in meta.by_origin().items())
    yield f"\nBy origin: {origins or 'none'}.\n\n## Columns\n\n| column | type | |\n| --- | --- | --- |"
    for field in schema(*meta.lengths):
        yield f"| `{field.name}` | {_type_of(field.type)} | {COLUMNS[field.name]} |"
    yield "\n## Read it\n\n```python\nfrom datasets import load_dataset\n"
    yield 'samples = load_dataset("FOLDER", "samples")["train"]  # everything: seeds are not split yet'
    if has_pull_outs:
        yield 'pull_outs = load_dataset("FOLDER", "pull_outs")["train"]  # they are in no class'
    yield 'roads = load_dataset("FOLDER", "roads")["train"]\n```\n\n## Licence and citation\n'
    yield f"Licence: {_stated(statement.license, 'license')}\n"
    yield f"Citation: {_stated(statement.citation, 'citation')}\n"
    if statement.creator is not None:
        yield f"Made by {html.escape(statement.creator)}.\n"
    if statement.url is not None:
        yield f"Published at <{html.escape(statement.url)}>.\n"
    made_by = ", ".join(f"{package} {version}" for package, version in meta.versions.items())
    yield f"Made with {made_by or 'isac-cosim'}. `{META_FILE}` holds every setting and a digest of every file."


def _type_of(kind: pa.DataType) -> str:
    """Return the type of a column as people write it: `float32 [6][2000]`."""
    shape = ""
    while pa.types.is_fixed_size_list(kind):
        shape, kind = f"{shape}[{kind.list_size}]", kind.value_type
    return f"{np.dtype(kind.to_pandas_dtype()).name if shape or pa.types.is_floating(kind) else kind} {shape}".strip()


def _stated(text: str | None, option: str) -> str:
    if text is not None:
        return html.escape(text)
    return f"nobody has stated one; `cosim describe FOLDER --{option} ...` does."
