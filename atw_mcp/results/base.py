"""Base of the models of results."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Result(BaseModel):
    """Data of a result, or a part of it. Fields that are not declared are refused."""

    model_config = ConfigDict(extra="forbid")
