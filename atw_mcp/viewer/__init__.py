"""The viewer: a case as one document, shown by one HTML page, in a report, over HTTP or inside an MCP host.

`document` is what is shown, `packing` its bytes, `web` the TypeScript of the page, which `viewer.html` bundles.
"""
