"""The pages of the documents: the tables in them that a command prints, and what they claim of them.

<!-- table STAGE: NAME -->        before a table, and its heading of the third level if it is printed with one; between
                                 them stands the command that makes it
<!-- figures: present STAGE -->   the figures of that stage are of the present settings, as a test checks
<!-- figures: earlier STAGE -->   they are of earlier ones
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import Path

from isac_cosim.base.errors import InputError
from isac_cosim.base.files import replace_file

TABLE = re.compile(
    r"^<!-- table (?P<stage>[\w-]+): (?P<name>.+) -->\n"
    r"(?P<heading>### .*\n\n)?(?:`make figures STAGE=[\w-]+`\n\n)?(?P<rows>(?:\|.*\n)*)",
    re.MULTILINE,
)
CLAIM = re.compile(r"^<!-- figures: (?P<which>present|earlier) (?P<stage>[\w-]+) -->$", re.MULTILINE)


def printed_tables(text: str) -> dict[str, str]:
    """Return the tables in printed Markdown by name, with their headings of the third level.

    The name is the heading up to a colon, behind which there may be counts; without a heading, the first cell.

    >>> printed_tables("### Leads: 12 windows\\n\\n| a |\\n| --- |\\n")
    {'Leads': '### Leads: 12 windows\\n\\n| a |\\n| --- |\\n'}
    """
    return {
        (found["heading"] or found["cell"]).strip(): found[0]
        for found in re.finditer(
            r"^(?:### (?P<heading>[^:\n]*).*\n\n)?\|(?P<cell>[^|\n]*)\|.*\n(?:\|.*\n)*", f"{text}\n", re.MULTILINE
        )
    }


def rewritten(page: str, stage: str, tables: Mapping[str, str]) -> str:
    """Return the text of a page with the tables of a stage in place, each under the command that makes it.

    tables: by name, as `printed_tables` returns them. Raises InputError where the page names one that is not there.
    """

    def table(found: re.Match[str]) -> str:
        if found["stage"] != stage:
            return found[0]
        if found["name"] not in tables:
            raise InputError(f"{stage}: prints no table {found['name']!r}; correct the page, or the stage's tables")
        *heading, rows = tables[found["name"]].split("\n\n")
        above = "".join(f"{line}\n\n" for line in (*heading, f"`make figures STAGE={stage}`"))
        return f"<!-- table {stage}: {found['name']} -->\n{above}{rows}"

    return TABLE.sub(table, page)


def rewrite(path: Path, stage: str, tables: Mapping[str, str]) -> None:
    """Rewrite a page in place, if that changes it. Raises InputError as `rewritten` does, with the page's name."""
    before = path.read_text(encoding="utf-8")
    try:
        after = rewritten(before, stage, tables)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    write_page(path, before, after)


def write_page(path: Path, before: str, after: str) -> None:
    """Write the text of a page, if it has changed. Raises OutputError."""
    if after != before:
        replace_file(path, lambda partial: partial.write_text(after, encoding="utf-8"))


def withdrawn(page: str, stages: Collection[str]) -> str:
    """Return the text of a page without the claim that the figures of these stages are present.

    >>> withdrawn("<!-- figures: present rates -->", ["rates"])
    '<!-- figures: earlier rates -->'
    """
    for stage in stages:
        page = page.replace(f"<!-- figures: present {stage} -->", f"<!-- figures: earlier {stage} -->")
    return page


def claims(page: str) -> dict[str, bool]:
    """Return the stages whose figures a page says it shows, and whether it claims that they are present."""
    return {found["stage"]: found["which"] == "present" for found in CLAIM.finditer(page)}


def tables_of(page: str) -> dict[tuple[str, str], str]:
    """Return every table of a page that a command prints, by stage and name, as it is printed."""
    return {(found["stage"], found["name"]): (found["heading"] or "") + found["rows"] for found in TABLE.finditer(page)}
