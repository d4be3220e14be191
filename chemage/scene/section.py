"""The base of what a scene consists of beside its components."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, ValidatorFunctionWrapHandler, field_validator

from chemage.foundation.booleans import no_booleans
from chemage.foundation.listing import without_noise


class Section(BaseModel):
    """A frozen set of options that is no component."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, use_attribute_docstrings=True)

    @field_validator("*", mode="wrap")
    @classmethod
    def _no_booleans(cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        return no_booleans(cls, value, handler, info)

    def __dir__(self) -> list[str]:
        return without_noise(type(self), super().__dir__())
