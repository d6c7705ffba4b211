"""`croissant.json` of a dataset: its Croissant 1.1 description, by which catalogues find it and programs read it.

Format: MLCommons, Croissant Format Specification 1.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa

from isac_cosim.labeling.dataset.dataset import DROPPED_PULL_OUTS, ROAD_SCHEMA, ROADS, SHARDS
from isac_cosim.labeling.dataset.meta import META_FILE, Meta
from isac_cosim.labeling.dataset.shard import schema
from isac_cosim.labeling.dataset.shard_index import INDEX_FILE
from isac_cosim.labeling.publication.card import summary_of, title_of
from isac_cosim.labeling.publication.columns import COLUMNS, ROAD_COLUMNS
from isac_cosim.labeling.publication.statement import Statement

CROISSANT_FILE = "croissant.json"
VERSION = "http://mlcommons.org/croissant/1.1"
PARQUET = "application/x-parquet"
TYPES = {
    pa.string(): "sc:Text", pa.int8(): "cr:Int8", pa.int16(): "cr:Int16", pa.int64(): "cr:Int64",
    pa.float32(): "cr:Float32", pa.float64(): "cr:Float64",
}  # fmt: skip
CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The context that the specification gives for descriptions."""


def croissant(meta: Meta, statement: Statement, digests: Mapping[str, str], has_pull_outs: bool) -> dict[str, Any]:
    """Return the content of croissant.json.

    digests: of `dataset.json` and the index, by name. has_pull_outs: whether the dataset keeps dropped pull-outs.
    """
    columns = schema(*meta.lengths)
    tables = [("samples", SHARDS, "the samples, a row each", columns, COLUMNS)]
    if has_pull_outs:
        tables.append(("pull_outs", DROPPED_PULL_OUTS, "pull-outs that are in no class, a row each", columns, COLUMNS))
    tables.append(("roads", ROADS, "the lanes of each scenario's road network, a row each", ROAD_SCHEMA, ROAD_COLUMNS))
    stated = {
        "license": statement.license,
        "citeAs": statement.citation,
        "creator": None if statement.creator is None else {"@type": "sc:Person", "name": statement.creator},
        "url": statement.url,
    }
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": VERSION,
        "name": title_of(meta),
        "description": summary_of(meta),
        "keywords": ["driver intention prediction", "integrated sensing and communication", "SUMO", "simulated"],
        **{key: value for key, value in stated.items() if value is not None},
        "distribution": [
            *(_file(name, digest) for name, digest in digests.items()),
            *(_file_set(name, folder) for name, folder, *_ in tables),
        ],
        "recordSet": [_record_set(name, text, fields, texts) for name, _, text, fields, texts in tables],
    }


def _file(name: str, digest: str) -> dict[str, Any]:
    text = {META_FILE: "how the dataset was made", INDEX_FILE: "what is in each shard, with its digest"}[name]
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "description": text,
        "contentUrl": name,
        "encodingFormat": "application/json" if name.endswith(".json") else PARQUET,
        "sha256": digest,
    }


def _file_set(name: str, folder: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileSet",
        "@id": f"{name}-files",
        "name": f"{name}-files",
        "description": f"the files of {name}",
        "encodingFormat": PARQUET,
        "includes": f"{folder}/*.parquet",
    }


def _record_set(name: str, text: str, columns: pa.Schema, texts: Mapping[str, str]) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": text,
        "field": [_field(name, column, texts[column.name]) for column in columns],
    }


def _field(record_set: str, column: pa.Field, text: str) -> dict[str, Any]:
    kind, shape = column.type, list[str]()
    while pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        shape.append(str(kind.list_size) if pa.types.is_fixed_size_list(kind) else "-1")
        kind = kind.value_type
    array = {"isArray": True, "arrayShape": ",".join(shape)} if shape else {}
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{column.name}",
        "name": column.name,
        "description": text,
        "dataType": TYPES[kind],
        **array,
        "source": {"fileSet": {"@id": f"{record_set}-files"}, "extract": {"column": column.name}},
    }
