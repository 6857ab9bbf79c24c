"""The statements of the paper, each once, and the verdicts that measurements give."""
