"""`python -m atw_mcp` is `atw-mcp`."""

import sys

from atw_mcp.cli import main

if __name__ == "__main__":
    sys.exit(main())
