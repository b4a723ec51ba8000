"""What all tables of the configuration share."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


def key(default: Any, allowed: str, **limits: Any) -> Any:
    """Declare a key; `allowed` completes the sentence "must be ..."."""
    return Field(default, description=allowed, **limits)


class Table(BaseModel):
    """Unknown keys and lax types are refused."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_default=True,
    )
