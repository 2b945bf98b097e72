"""Leaves of the problem file: kinds of values, what each expects, and how a message shows what was found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from harness_opt.model.checks import LARGEST, one_of
from harness_opt.numerics import rotations

QUATERNION_TOLERANCE = 1e-3  # largest | |q| - 1 | taken as rounding: three typed digits do; normalised then
SMALLEST = 1e-100  # of a number that has to be above 0: nothing that is divided by it may overflow
SHORTEST = 1e-100  # direction, in any unit: its square must not vanish

MESH_UNITS = ("m", "cm", "mm", "in")
UP_AXES = ("y", "z")


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
            size = abs(value) if isinstance(value, (int, float)) else 0
            words = self.words + (f", at most {LARGEST:g} in size" if LARGEST < size < math.inf else "")
            words += f", at least {SMALLEST:g}" if 0 < size < SMALLEST and value > 0 else ""
            raise PydanticCustomError("expected", "{words}", {"words": words}) from None


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
