"""Nodes joined by branches, and which of them are connected."""

from __future__ import annotations


class Forest:
    """Nodes in trees, joined by branches."""

    def __init__(self) -> None:
        self.parents: dict[str, str] = {}

    def root(self, node: str) -> str:
        """Return the node that stands for the tree."""
        while node in self.parents:
            node = self.parents[node]
        return node

    def join(self, one: str, other: str) -> bool:
        """Join two trees; return False where the nodes are in one tree already."""
        one, other = self.root(one), self.root(other)
        if one == other:
            return False
        self.parents[one] = other
        return True
