"""The MCP server, its tools, and the perception behind them.

Front doors: `server` builds it and `serving` runs it; `cli` starts one (`server_process`) and calls its tools
(`sessions`, `client`, over `pipes`) for `script` and `shell`. Rooms from the ground up: `calls` (how a call is read,
run and answered), `perception` (video in, observations out), `looking` (pictures), `cases` (a case, and where its
values came from), `models` (learned models), `worlds`, `observation`, `fitting`, `probing`, `gap` (each a domain's
work), `viewer` (a case as one HTML page), `tools` (one thin function a tool; `tools.manifest` lists them without
importing them), `batch` (many cases in one go), and `transports` (messages in and out, their limits).
"""
