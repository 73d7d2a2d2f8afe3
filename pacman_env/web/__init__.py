"""The operator's page: a game shown, played and run in any browser (docs/web.md)."""
