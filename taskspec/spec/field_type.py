"""What a field of a model can hold: the base of all kinds of value."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from taskspec.spec.parse_context import ParseContext


class FieldType(ABC):
    """Reads a datum, reports what is wrong with it, and describes itself to editors.

    Used as the metadata of an `Annotated` type. A datum that cannot be read is reported and
    replaced by a stand-in; the whole task is then thrown away, so the stand-in goes nowhere.
    """

    @abstractmethod
    def read(self, value: object, context: ParseContext) -> object:
        """The value of a datum, or a stand-in after reporting what is wrong."""

    @abstractmethod
    def json(self) -> dict[str, Any]:
        """The JSON Schema; it rejects nothing that `read` accepts."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def run(value: object, info: core_schema.ValidationInfo) -> object:
            # Models made in Python, without a file behind them, hold final values already.
            return self.read(value, info.context) if info.context is not None else value

        return core_schema.with_info_plain_validator_function(run)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return self.json()
