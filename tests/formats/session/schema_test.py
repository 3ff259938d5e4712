# SPDX-License-Identifier: Apache-2.0
"""The shipped scenes and device descriptions conform to the JSON
Schemas of formats/session/, and documents with one broken rule do not.

The broken rules come from the schema itself: at every place of a document a wrong type,
a number out of range, a list too short or too long, a required key removed, an unknown
key added.
"""
import copy
import json

import jsonschema
import pytest

# (documents, schema)
SHIPPED = [
    ("runtime/scenes/*.json", "formats/session/scene.schema.json"),
    ("formats/session/four_legs.json", "formats/session/device.schema.json"),
    ("runtime/device/[!f]*.json", "formats/session/pose_device.schema.json"),
    ("runtime/device/force_*.json", "formats/session/pose_device.schema.json"),
]
SAMPLES = {"object": {}, "array": [], "string": "x", "number": 0.5, "boolean": True, "null": None}


def resolve(schema, root):
    while "$ref" in schema:
        node = root
        for part in schema["$ref"].removeprefix("#/").split("/"):
            node = node[part]
        schema = {**node, **{k: v for k, v in schema.items() if k != "$ref"}}
    return schema


def wrong_values(value, schema):
    """Values that `schema` alone forbids in place of `value`, each with a reason."""
    kinds = schema.get("type", [])
    kinds = {kinds} if isinstance(kinds, str) else set(kinds)
    if kinds:
        for kind, sample in SAMPLES.items():
            if kind not in kinds and not (kind == "number" and "integer" in kinds):
                yield f"is a {kind}", sample
        if "integer" in kinds and "number" not in kinds:
            yield "is a fraction", 1.5
    if "const" in schema:
        yield "is another constant", "something else"
    if "enum" in schema:
        yield "is not in the list", "something else"
    for key, step in (("minimum", -1), ("maximum", 1)):
        if key in schema:
            yield f"is beyond its {key}", schema[key] + step
    for key in ("exclusiveMinimum", "exclusiveMaximum"):
        if key in schema:
            yield f"is at its {key}", schema[key]
    if schema.get("minLength", 0) > 0 and isinstance(value, str):
        yield "is empty", ""
    if isinstance(value, list):
        if schema.get("minItems", 0) > 0:
            yield "is too short", value[: schema["minItems"] - 1]
        if "maxItems" in schema and value:
            yield "is too long", (value * (schema["maxItems"] + 1))[: schema["maxItems"] + 1]
    if isinstance(value, dict):
        for key in schema.get("required", []):
            yield f"lacks {key}", {k: v for k, v in value.items() if k != key}
        if schema.get("additionalProperties") is False:
            yield "has an unknown key", {**value, "no_such_key": 1}


def walk(value, schema, root, path=()):
    """Every place of a document with its part of the schema."""
    schema = resolve(schema, root)
    yield path, value, schema
    if isinstance(value, dict):
        for key, child in value.items():
            if key in schema.get("properties", {}):
                yield from walk(child, schema["properties"][key], root, path + (key,))
    elif isinstance(value, list):
        for i, child in enumerate(value):
            fixed = schema.get("prefixItems", [])
            items = fixed[i] if i < len(fixed) else schema.get("items")
            if isinstance(items, dict):
                yield from walk(child, items, root, path + (i,))


def replaced(document, path, value):
    if not path:
        return value
    changed = copy.deepcopy(document)
    node = changed
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    return changed


def mutations(document, schema):
    for path, value, part in walk(document, schema, schema):
        for reason, wrong in wrong_values(value, part):
            yield f"/{'/'.join(map(str, path))} {reason}", replaced(document, path, wrong)


@pytest.mark.parametrize("pattern, schema_name", SHIPPED)
def test_shipped_files(source, pattern, schema_name):
    schema = json.loads((source / schema_name).read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    schema.pop("$id", None)  # python3-jsonschema 4.10 joins a relative one to itself
    validator = jsonschema.Draft202012Validator(schema)
    documents = sorted(source.glob(pattern))
    assert documents, f"{pattern}: nothing is shipped"
    for path in documents:
        document = json.loads(path.read_text())
        errors = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(document)]
        assert not errors, f"{path.name}: {errors}"
        changes = list(mutations(document, schema))
        assert len(changes) >= 20, f"{path.name}: the schema forbids next to nothing ({len(changes)} changes)"
        for reason, changed in changes:
            assert not validator.is_valid(changed), f"{path.name}: accepted although {reason}"
