"""The command line: one file a command, listed in one table (:mod:`motiondlo.cli.commands`)."""
