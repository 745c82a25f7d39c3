"""The card beside a model: what it flies, how it was made, and the model's own sha256."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

CARD = ("information", "algo", "residual", "steps")  # what is read of it besides its sha256
RESIDUAL = {"law", "scale"}  # and "reads" where the network is told the law's command


def digest(path: Path) -> str:
    """sha256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_card(model: Path) -> dict[str, Any]:
    """`card.json` beside a model, its sha256 checked; empty where there is none."""
    path = model.with_name("card.json")
    if not path.exists():
        return {}
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}") from None
    if not isinstance(card, dict) or card.get("sha256") != digest(model):
        raise ValueError(
            f"{path} does not belong to {model.name}: the sha256 differs; "
            "take both files from one training, "
            "or remove the card to load the network alone"
        )
    if lacking := [name for name in CARD if name not in card]:
        raise ValueError(
            f"{path} does not say {', '.join(lacking)}; expected what `python -m train.sb3` writes"
        )
    residual = card["residual"]
    if residual is not None and not (
        isinstance(residual, dict)
        and set(residual) in (RESIDUAL, RESIDUAL | {"reads"})
        and isinstance(residual.get("reads", []), list)
    ):
        raise ValueError(
            f'{path}: residual must be null or {{"law": NAME, "scale": NUMBER}}, and may have '
            f'"reads": [FIELD, ...], got {residual!r}'
        )
    return card
