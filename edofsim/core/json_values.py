"""What JSON, TOML and the attributes of files hold."""

from __future__ import annotations

from typing import Any, TypeAlias

# Whoever reads such a file looks up what it needs; what else is in it, nobody promises.
Json: TypeAlias = dict[str, Any]  # pyrefly: ignore[explicit-any]
"""An object of JSON, or a table of TOML."""
