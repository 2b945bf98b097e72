"""A hook of MkDocs: tables of keys, made from the program's own schemas while the site is built.

A page says ``<!-- generated: problem file -->``, ``<!-- generated: study file -->`` or ``<!-- generated: results -->``.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

MARKER = re.compile(
    r"<!-- generated: (problem file|study file|results) -->\n(?:.*?<!-- end of generated -->)?", re.DOTALL
)
# a unit as descriptions name it, the longest first
UNIT = re.compile(r"(?<![\w/'])(N m2|N m|kg/m3|kg/m|degrees/m|m/s2|1/m|degrees|percent|N|m|s)(?![\w/])")
UNIT_OF_END = {"_deg_per_m": "deg/m", "_deg": "deg", "_percent": "%"}
TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "list",
    "object": "table",
    "null": "null",
}
SETS = {"cables", "bodies", "parts"}  # tables whose entries the user names

Schema = dict[str, Any]


def on_page_markdown(markdown: str, /, **_: Any) -> str:
    """Put the tables where the page asks for them."""
    return MARKER.sub(_generated, markdown)


def _generated(found: re.Match[str]) -> str:
    if found[1] == "problem file":
        from harness_opt.files.read import schema

        return "\n".join(sections(schema()))
    if found[1] == "study file":
        from harness_opt.studies.study_file import StudyTable

        return "\n".join(sections(StudyTable.model_json_schema(by_alias=True)))
    results = _results_schema()
    # what the page has between the markers, where the program has no schema of its results
    return found[0] if results is None else "\n".join(sections(results))


def _results_schema() -> Schema | None:
    """Return what ``harness-opt schema --results`` prints, or None where there is no such option."""
    done = subprocess.run(
        [sys.executable, "-m", "harness_opt", "schema", "--results"], capture_output=True, text=True, check=False
    )
    return json.loads(done.stdout) if done.returncode == 0 else None


# --- a section for each table ---------------------------------------------------------------------------


def sections(schema: Schema) -> Iterator[str]:
    """Yield the lines of all tables of ``schema``, each before the tables in it."""
    found: dict[str, tuple[list[str], Schema]] = {}
    _gather(schema, schema, "", found)
    for places, table in found.values():
        yield f"\n### {' and '.join(heading(place) for place in places)}\n"
        # of a table in two places what it is itself, not what it is in the first of them
        told = schema.get("$defs", {}).get(table.get("title"), table).get("description", "")
        yield f"{escaped(told)}\n"
        yield from rows(schema, table)


def _gather(schema: Schema, table: Schema, place: str, found: dict[str, tuple[list[str], Schema]]) -> None:
    """Put ``table`` and those in it into ``found``, by title; the same table in two places is one."""
    title = table.get("title", place)
    if title in found:
        found[title][0].append(place)
        return
    found[title] = ([place], table)
    for name, inner in table.get("properties", {}).items():
        for below, target in inner_tables(schema, name, inner):
            _gather(schema, target, f"{place}.{below}" if place else below, found)


def heading(place: str) -> str:
    """Return the heading of the table at ``place``."""
    if not place:
        return "The file itself"
    path, _, kind_given = place.partition(": ")
    return f"`[{path}]`" + (f" with `{kind_given}`" if kind_given else "")


def rows(schema: Schema, table: Schema) -> Iterator[str]:
    """Yield the lines of one table of keys."""
    required = set(table.get("required", ()))
    properties = table.get("properties", {})
    if not properties:
        return
    yield "| key | type | unit | default | meaning |"
    yield "|---|---|---|---|---|"
    for name, given in properties.items():
        entry = resolved(schema, given)
        default = "**required**" if name in required else shown(entry.get("default"))
        unit = unit_of(name, entry)
        yield f"| `{name}` | {escaped(kind(schema, entry))} | {unit} | {default} | {escaped(meaning(entry))} |"
    yield ""


def inner_tables(schema: Schema, name: str, entry: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the tables that the key ``name`` holds, each with the key that leads there."""
    whole = resolved(schema, entry)
    choices = [whole] if whole.get("properties") else whole.get("oneOf") or whole.get("anyOf") or [whole]
    for choice in (resolved(schema, choice) for choice in choices):
        if choice.get("properties"):
            named = [value["const"] for value in choice["properties"].values() if "const" in value]
            yield (f'{name}: kind = "{named[0]}"' if named and len(choices) > 1 else name), choice
        elif choice.get("type") == "array" and "items" in choice:
            inner = resolved(schema, choice["items"])
            if inner.get("properties"):
                yield f"{name}[]", inner
        elif isinstance(choice.get("additionalProperties"), dict):
            inner = resolved(schema, choice["additionalProperties"])
            choices = [inner] if inner.get("properties") else inner.get("anyOf") or inner.get("oneOf") or [inner]
            for one in (resolved(schema, choice) for choice in choices):
                if one.get("properties"):
                    yield f"{name}.{'NAME' if name in SETS else 'KEY'}", one


def resolved(schema: Schema, entry: Schema) -> Schema:
    """Return ``entry`` with what it refers to; its own words count more."""
    if "$ref" not in entry:
        return entry
    target = schema["$defs"][entry["$ref"].rpartition("/")[2]]
    return {**target, **{key: value for key, value in entry.items() if key != "$ref"}}


# --- cells -----------------------------------------------------------------------------------------------


def kind(schema: Schema, entry: Schema) -> str:
    """Return the type of a value in words."""
    entry = resolved(schema, entry)
    choices = entry.get("anyOf") or entry.get("oneOf")
    if "const" in entry or "enum" in entry:
        words = " or ".join(f"`{json.dumps(value)}`" for value in entry.get("enum", [entry.get("const")]))
    elif choices and not entry.get("properties"):
        kinds = dict.fromkeys(kind(schema, choice) for choice in choices)
        words = " or ".join(one for one in kinds if one != "null")
    elif "prefixItems" in entry:
        items = entry["prefixItems"]
        words = f"list of {len(items)} {TYPES.get(items[0].get('type'), 'value')}s"
    else:
        words = TYPES.get(entry.get("type", "object" if entry.get("properties") else ""), "any")
    return words


def unit_of(name: str, entry: Schema) -> str:
    """Return the unit of a value, as its key or its description names it."""
    if "unit" in entry:
        return escaped(str(entry["unit"]))
    named = [unit for end, unit in UNIT_OF_END.items() if name.endswith(end)]
    if named:
        return named[0]
    if '"number"' not in json.dumps(entry) or entry.get("properties") or "additionalProperties" in entry:
        return ""
    words = entry.get("description", "")
    found = UNIT.search(words)
    if found is None or "key's unit" in words:
        return "the key's" if found is None and "key's unit" in words else ""
    return found[1].replace("degrees", "deg").replace("percent", "%")


def meaning(entry: Schema) -> str:
    """Return the description of a key, with the range that it must be in."""
    words = entry.get("description", "")
    least, most = entry.get("exclusiveMinimum"), entry.get("exclusiveMaximum")
    if entry.get("minimum") == 0:
        words += " 0 or more."
    elif entry.get("minimum") is not None and entry["minimum"] > 0:
        words += " Above 0."
    if least is not None and most is not None:
        words += f" Above {least}, below {most}."
    return words


def shown(value: Any) -> str:
    """Return a default as the file would have it."""
    if value is None or value in ("", {}, []):
        return "none"
    return f"`{json.dumps(value)}`"


def escaped(words: str) -> str:
    """Return words that a cell of a table can hold."""
    return words.replace("|", "\\|").replace("<", "&lt;")
