"""A table of a TOML file: refuses unknown keys and says what it expects."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from harness_opt.files.values import Expected, one_of


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
