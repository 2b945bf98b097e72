"""Leaves of the problem file: kinds of values, what each expects, and how a message shows what was found."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    JsonValue,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from harness_opt.model.checks import INVALID, LARGEST, SMALLEST, KeyPath, Mistake, by_name, one_of, shown, sized
from harness_opt.model.parts import MESH_UNITS, UP_AXES
from harness_opt.numerics import rotations

QUATERNION_TOLERANCE = 1e-3  # largest | |q| - 1 | taken as rounding: three typed digits do; normalised then
SHORTEST = 1e-100  # direction, in any unit: its square must not vanish

MOTION_KINDS = ("hinge", "slide", "poses")


@dataclass(frozen=True)
class Expected:
    """Annotation that puts ``words`` in the place of pydantic's own message, whatever is wrong inside."""

    words: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Wrap the schema of the annotated type."""
        return core_schema.no_info_wrap_validator_function(self.check, handler(source))

    def check(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        """Return ``value`` validated by ``inner``, or raise the error that says what was expected."""
        try:
            return inner(value)
        except ValidationError:
            raise PydanticCustomError("expected", "{words}", {"words": sized(self.words, value)}) from None


def _unit(q: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*q)
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        words = f"a unit quaternion [w, x, y, z] (this one is {length:.6g} long)"
        raise PydanticCustomError("expected", "{words}", {"words": words})
    return tuple(rotations.unit(q).tolist())


def _nonzero(v: tuple[float, ...]) -> tuple[float, ...]:
    if not math.hypot(*v) > SHORTEST:
        raise PydanticCustomError("expected", "a direction, not zero")
    return v


def _no_zeros(scale: float | tuple[float, ...]) -> float | tuple[float, ...]:
    if not all(abs(number) >= SMALLEST for number in (scale if isinstance(scale, tuple) else (scale,))):
        raise PydanticCustomError("expected", "a number that is not 0, or [x, y, z], three such numbers")
    return scale


def _bounded(number: float) -> float:
    if abs(number) > LARGEST:
        raise PydanticCustomError("expected", "a number")
    return number


def _whole(value: Any) -> Any:
    """Let ``1.0`` stand for 1, and keep pydantic's strict int from the rest."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def only_integer(value: Any) -> Any:
    """Return ``value`` if it is an int, else None: True == 1.0 == 1, which ``Literal[1]`` lets pass."""
    return value if type(value) is int else None


_Float = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Finite = Annotated[_Float, AfterValidator(_bounded)]
_Above0 = Annotated[_Float, Field(ge=SMALLEST), AfterValidator(_bounded)]
_AtLeast0 = Annotated[_Float, Field(ge=0), AfterValidator(_bounded)]
_Triple = tuple[_Finite, _Finite, _Finite]

_Below1 = Annotated[_Float, Field(gt=0, lt=1)]

Number = Annotated[_Finite, Expected("a number")]
Positive = Annotated[_Above0, Expected("a number above 0")]
NotNegative = Annotated[_AtLeast0, Expected("a number of at least 0")]
Share = Annotated[_Below1, Expected("a number between 0 and 1")]
Whole = Annotated[int, Field(strict=True), BeforeValidator(_whole), Expected("a whole number")]
Seed = Annotated[int, Field(strict=True, ge=0), BeforeValidator(_whole), Expected("a whole number of at least 0")]
Flag = Annotated[bool, Field(strict=True), Expected("true or false")]
Text = Annotated[str, Field(strict=True), Expected("text in quotes")]
Digest = Annotated[
    str, Field(strict=True, pattern="^[0-9a-fA-F]{64}$"), Expected("a SHA-256, 64 hexadecimal digits in quotes")
]
Vector = Annotated[_Triple, Expected("[x, y, z], three numbers")]
Direction = Annotated[_Triple, Expected("[x, y, z], three numbers"), AfterValidator(_nonzero)]
Size = Annotated[tuple[_Above0, _Above0, _Above0], Expected("[x, y, z], three numbers above 0")]
Quaternion = Annotated[
    tuple[_Finite, _Finite, _Finite, _Finite],
    Expected("[w, x, y, z], four numbers of a unit quaternion"),
    AfterValidator(_unit),
]
Bending = Annotated[_Above0 | tuple[_Above0, _Above0], Expected("a number above 0, or [kx, ky], two numbers above 0")]
BEND_USES = ("fixed", "flexing", "chain")
BendFactor = Annotated[
    _Above0 | Literal["fixed", "flexing", "chain"], Expected(f"a number above 0, or {one_of(BEND_USES)}")
]
Bounds = Annotated[
    tuple[_Finite, _Finite] | Annotated[str, Field(strict=True)],
    Expected('[lower, upper], two numbers, or text such as "= lead.start.position.x", "= 2 * lead.length + 0.01"'),
]


RollWord = Annotated[Literal["untwisted", "free"], Expected(one_of(("untwisted", "free")))]
MotionValue = Annotated[float, Field(strict=True, ge=0, le=1), Expected("a number from 0 to 1")]
MeshUnit = Annotated[Literal["m", "cm", "mm", "in"], Expected(one_of(MESH_UNITS))]
Scale = Annotated[
    _Finite | _Triple,
    Expected("a number that is not 0, or [x, y, z], three such numbers"),
    AfterValidator(_no_zeros),
]
ShapesOfLinks = Annotated[Literal["collision", "visual"], Expected(one_of(("collision", "visual")))]
AngleUnit = Annotated[Literal["rad", "deg"], Expected(one_of(("rad", "deg")))]
TravelUnit = Annotated[Literal["m", "mm"], Expected(one_of(("m", "mm")))]
UpAxis = Annotated[Literal["y", "z"], Expected(one_of(UP_AXES))]


class Table(BaseModel):
    """A table of the file: refuses unknown keys and says what it expects."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        """Put our words on the errors of this table: only here are its keys known."""
        try:
            return handler(data)
        except ValidationError as error:
            lines = [InitErrorDetails(type=cls._worded(e), loc=e["loc"], input=e["input"]) for e in error.errors()]
            raise ValidationError.from_exception_data(cls.__name__, lines) from None

    @classmethod
    def keys(cls) -> dict[str, Any]:
        """Return the keys as a user types them, with their pydantic fields."""
        return {field.alias or name: field for name, field in cls.model_fields.items()}

    @classmethod
    def _worded(cls, error: Any) -> PydanticCustomError:
        """Return pydantic's ``error`` as one whose message is what was expected."""
        kind, key = error["type"], str(error["loc"][-1]) if error["loc"] else ""
        if kind == "extra_forbidden":
            return PydanticCustomError("unknown", "{words}", {"words": one_of(cls.keys(), key)})
        if kind == "missing":
            marks = [mark for mark in cls.keys()[key].metadata if isinstance(mark, Expected)]
            return PydanticCustomError("nothing", "{words}", {"words": marks[0].words if marks else "a table"})
        if kind in ("union_tag_invalid", "union_tag_not_found"):
            is_table = isinstance(error["input"], dict)
            return PydanticCustomError("kind" if is_table else "expected", "{words}", {"words": "a table"})
        if kind in ("model_type", "model_attributes_type", "dict_type"):
            return PydanticCustomError("expected", "a table")
        return PydanticCustomError(kind, "{words}", {"words": error["msg"]})


def not_both(*keys: str) -> list[JsonValue]:
    """Return the JSON Schema of "at most one of ``keys``"."""
    pairs: list[JsonValue] = [[a, b] for i, a in enumerate(keys) for b in keys[i + 1 :]]
    return [{"not": {"required": pair}} for pair in pairs]


def required_unless(key: str, *others: str, **more: Any) -> Callable[[dict[str, Any]], None]:
    """Return what has the JSON Schema of a table ask for ``others`` only where ``key`` is missing, and add ``more``."""

    def change(schema: dict[str, Any]) -> None:
        required = [name for name in schema["required"] if name not in others]
        schema |= {"required": required, "anyOf": [{"required": [key]}, {"required": list(others)}], **more}

    return change


TableKind = TypeVar("TableKind", bound=Table)


def schema_of(table: type[Table], title: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a file whose keys are those of ``table``."""
    generated = table.model_json_schema(schema_generator=_FileSchema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **generated, "title": title}


class _FileSchema(GenerateJsonSchema):
    """JSON Schema without null: TOML has none, an optional key is left out instead."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        """Return the schema of what is not null."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """Return the schema with its default, unless that is null or a table of nulls."""
        generated = super().default_schema(schema)
        return {k: v for k, v in generated.items() if k != "default" or not isinstance(v, dict | None)}


# --- a file against its tables, key by key ------------------------------------------------------------------------


def structured(
    raw: Mapping[str, Any], model: type[TableKind]
) -> tuple[TableKind | None, dict[str, Any], list[Mistake]]:
    """Validate a parsed file key by key.

    Args:
        raw: the nested tables, as :mod:`tomllib` gives them; INVALID in them is known to be wrong, and not told again.
        model: what the file holds.

    Returns:
        The tables, or None where there are mistakes; a copy of ``raw`` with :data:`INVALID` in the place of
        every wrong value, so that what is left can be checked further; and the mistakes, tables of an array told by
        their names where they have one.
    """
    tree = _copied(raw)
    try:
        return model.model_validate(raw), tree, []
    except ValidationError as error:
        return None, tree, [_mistake(tree, e) for e in error.errors() if e["input"] is not INVALID]


def _copied(value: Any) -> Any:
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):  # [[tables]] in a row
        return [_copied(item) for item in value]
    return {key: _copied(item) for key, item in value.items()} if isinstance(value, Mapping) else value


def _mistake(tree: dict[str, Any], error: Any) -> Mistake:
    """Return ``error`` in words, and put :data:`INVALID` in its place in ``tree``."""
    steps, path = _path(tree, error)
    value, words = error["input"], error["msg"]
    if error["type"] == "nothing":
        return path, f"found nothing, expected {words}"
    parent: Any = tree
    for step in steps[:-1]:
        parent = parent[step]
    parent[steps[-1]] = INVALID
    if error["type"] == "unknown":
        return path, f"found an unknown key, expected {words}"
    if error["type"] == "kind":
        kind = value.get("kind")
        found = "nothing" if kind is None else shown(kind)
        return (*path, "kind"), f"found {found}, expected {one_of(MOTION_KINDS, kind)}"
    if error["type"] == "too_short":
        found, one = ("an empty table", "cable") if path == ("cables",) else (shown(value), "table")
        return path, f"found {found}, expected at least one {one}"
    if path[:2] == ("design", "variables") and isinstance(value, Mapping):
        words += f", behind a name in quotes such as {json.dumps(path[2] + '.length')}"
    return path, f"found {shown(value)}, expected {words}"


def _path(tree: dict[str, Any], error: Any) -> tuple[list[str | int], KeyPath]:
    """Return the steps that lead to an error, pydantic's location without the tags of unions, and the keys told."""
    node: Any = tree
    steps: list[str | int] = []
    path: list[str] = []
    for step in error["loc"]:
        row = isinstance(node, list) and isinstance(step, int) and any(isinstance(item, Mapping) for item in node)
        if row or (isinstance(node, dict) and step in node):
            path.append(list(by_name(node))[step] if row else str(step))
            steps.append(step)
            node = node[step]
    if error["type"] == "nothing":
        path.append(str(error["loc"][-1]))
    return steps, tuple(path)
