"""Campaigns with real processes in real time: figures for a release, too slow for every change."""
