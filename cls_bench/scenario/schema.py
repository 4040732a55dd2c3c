"""JSON schema of the scenario file."""

from typing import Any

from cls_bench.input.faults import TomlSchema
from cls_bench.parameters import Parameters, Section
from cls_bench.scenario.scenario import Scenario


def scenario_schema() -> dict[str, Any]:
    """JSON schema of the scenario file for editors, with descriptions, units, defaults and all parameters."""
    schema = Scenario.model_json_schema(schema_generator=TomlSchema)
    for properties, live_only in ((schema["properties"], False), (schema["$defs"]["Change"]["properties"], True)):
        description = properties["parameters"]["description"]
        properties["parameters"] = _section_schema(Parameters(), live_only) | {"description": description}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _section_schema(section: Section, live_only: bool) -> dict[str, Any]:
    own = type(section).model_json_schema(schema_generator=TomlSchema)["properties"]
    properties: dict[str, Any] = {}
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, Section):
            inner = _section_schema(value, live_only)
            if inner["properties"]:
                properties[name] = inner
        elif own[name]["live"] or not live_only:
            properties[name] = own[name] | {"default": value}
    description = (type(section).__doc__ or "").strip().splitlines()[0]
    return {"type": "object", "description": description, "properties": properties, "additionalProperties": False}
