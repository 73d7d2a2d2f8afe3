"""Operator page: show, play and control a game in any browser (docs/web.md)."""
