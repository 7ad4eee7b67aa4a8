"""`atw-mcp view`: a local page over a store that follows a case while others work on it."""
