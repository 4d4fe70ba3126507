"""Scoring a skill against labeled regions."""
