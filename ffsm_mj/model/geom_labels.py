"""Labels of geoms for messages, records and scenarios; vendors leave many geoms without a name."""

from __future__ import annotations

from collections import Counter
from typing import Any


def geom_labels(model: Any) -> tuple[str, ...]:
    """A unique label for each geom: its name, or ``<body>[k]`` for the geom k of its body, from 0."""
    labels = []
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        place = f"{model.body(body).name or f'body {body}'}[{geom - int(model.body_geomadr[body])}]"
        labels.append(model.geom(geom).name or place)
    return tuple(labels)


def short_labels(labels: tuple[str, ...]) -> tuple[str, ...]:
    """The labels without the prefix of their model, where what remains is unique."""
    bare = [label.split("/", 1)[-1] for label in labels]
    count = Counter(bare)
    return tuple(
        short if count[short] == 1 and short not in labels else label for short, label in zip(bare, labels, strict=True)
    )
