"""Studies: variants of a scenario compared run by run over the same samples."""
