"""``python -m tactibench`` is the command ``tactibench``."""

from tactibench.cli.main import run

if __name__ == "__main__":
    run()
