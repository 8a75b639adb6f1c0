"""Commands of ``motiondlo`` that start or examine daemons."""
