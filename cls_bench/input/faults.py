"""One line for each fault of a scenario: the key, the value, what would be valid."""

import difflib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from cls_bench.text import escaped

MOST_NAMES = 30
"""Names in a list of what is valid."""


class FaultError(Exception):
    """Something wrong at a key of the scenario."""

    def __init__(self, key: str, problem: str):
        said = ".".join(escaped(part) for part in key.split("."))
        super().__init__(f"{said}: {problem}" if key else problem)
        self.key = key
        self.problem = problem


def shown(value: Any) -> str:
    """A value as it stands in a message, cut short."""
    return escaped(json.dumps(value, ensure_ascii=False, default=str))


def listed(names: Sequence[str]) -> str:
    """Names with commas between them."""
    return ", ".join(names) if names else "none"


def nearest(name: str, valid: Sequence[str] | Mapping[str, Any]) -> str:
    """The valid names that resemble ``name``, or all; of many only what stands before their first dot."""
    names = list(valid)
    close = difflib.get_close_matches(name[:100], names, n=3, cutoff=0.6)
    if close:
        return f"did you mean {' or '.join(close)}?"
    if len(names) > MOST_NAMES:
        parts = [known.partition(".") for known in names]
        names = list(dict.fromkeys(f"{head}.…" if dot else head for head, dot, _ in parts))
    return f"valid: {listed(names)}"


def wanted_in(schema: Mapping[str, Any]) -> str:
    """What a key takes, in words, from its JSON schema."""
    if "const" in schema:
        text = shown(schema["const"])
    elif "enum" in schema:
        text = "one of " + ", ".join(shown(choice) for choice in schema["enum"])
    else:
        kinds = {"number": "a number", "integer": "a whole number", "boolean": "true or false", "string": "a text"}
        kinds |= {"object": "a table", "array": "an array"}
        text = kinds.get(schema.get("type", "object"), "a table")
        if schema.get("minLength"):
            text += " that is not empty"
        if "maxLength" in schema:
            text += f", of {schema['maxLength']} characters at most"
        if "prefixItems" in schema:
            text = f"an array of {len(schema['prefixItems'])} numbers"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = [f"{sign} {schema[key]:g}" for key, sign in signs.items() if key in schema]
    text += " " + " and ".join(bounds) if bounds else ""
    if "unit" in schema:
        text += "" if schema["unit"] == "1" else f" [{schema['unit']}]"
    meaning = str(schema.get("description", "")).replace("\n", " ")
    return f"{text} ({meaning})" if meaning else text


def problem_of(error: Mapping[str, Any], model: type[BaseModel], kinds: Sequence[str] = ()) -> str:
    """What is wrong, and what ``model`` would take, in the words of this project; ``kinds`` are those of a union."""
    field = error["loc"][-1] if error["loc"] else ""
    properties = model.model_json_schema(schema_generator=TomlSchema)["properties"]
    kind = error["type"]
    if kind == "extra_forbidden":
        return f"unknown key; {nearest(str(field), properties)}"
    if kind == "union_tag_invalid":
        return f"{shown(error['ctx']['tag'])} is unknown; {nearest(str(error['ctx']['tag']), kinds)}"
    if kind == "union_tag_not_found":
        return f"missing; valid: {listed(kinds)}"
    if kind == "value_error":
        return str(error["ctx"]["error"])
    if kind == "too_long" and "actual_length" in error["ctx"]:
        return f"has {error['ctx']['actual_length']} entries; at most {error['ctx']['max_length']} are valid"
    wanted = wanted_in(properties[field]) if field in properties else "a table"
    if kind == "missing":
        return f"missing; give {wanted}"
    return f"{shown(error['input'])} is not valid; give {wanted}"


class TomlSchema(GenerateJsonSchema):
    """JSON schema without null: TOML has none, an absent key stands for it."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """The inner schema."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Without a default that is None."""
        inner = schema["schema"]
        return self.generate_inner(inner) if schema.get("default", ...) is None else super().default_schema(schema)
