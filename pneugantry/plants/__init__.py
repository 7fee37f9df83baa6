"""Descriptions of plants that come with the package."""
