"""Reading configuration: TOML and ``--set`` into pydantic models, with errors that name field, value and bound."""
