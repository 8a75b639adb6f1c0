"""The bus: zenoh behind the topic table. The one place that opens sessions."""
