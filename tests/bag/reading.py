"""What the checks of recordings share."""

import sys

from rosbags.typesys import get_types_from_msg


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def embedded_types(definition, name):
    """Every type in an embedded definition, parsed by rosbags."""
    blocks = definition.split("=" * 80 + "\n")
    types = get_types_from_msg(blocks[0], name)
    for block in blocks[1:]:
        head, body = block.split("\n", 1)
        types.update(get_types_from_msg(body, head.removeprefix("MSG: ").replace("/", "/msg/")))
    return types
