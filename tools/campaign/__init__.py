"""Campaigns: many flights of one mission with dispersed conditions, kept in a folder and judged."""
