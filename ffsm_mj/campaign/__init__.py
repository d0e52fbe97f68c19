"""Campaigns: many dispersed runs of one scenario, resumable, in one table."""
