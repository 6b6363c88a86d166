from pathlib import Path


def demo(out: Path = Path("demo")) -> None:
    """X"""
