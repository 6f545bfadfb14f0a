"""The faces that a camera sees and what is in them, each with its time; pure."""

from fusion_affect.align import Newest, seconds
from fusion_affect.state import Expression
from fusion_affect.tree import Limits


class Faces:
    """Faces and expressions as they were told; asked for what held at a time."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._tracked: Newest[frozenset[str]] = Newest()
        self._expressions: dict[str, Newest[Expression]] = {}

    def track(self, time_ns: int, face_ids: frozenset[str]) -> None:
        """These faces, and no others, are tracked from time_ns on."""
        self._tracked.put(time_ns, face_ids)

    def express(self, time_ns: int, face_id: str, expression: Expression) -> None:
        """A face shows an expression at time_ns."""
        self._expressions.setdefault(face_id, Newest()).put(time_ns, expression)

    def forget(self, face_id: str) -> None:
        """A face's expression is no longer on the graph."""
        self._expressions.pop(face_id, None)

    def fresh(self, time_ns: int) -> frozenset[str] | None:
        """The tracked faces; where nobody lists them, those with expressions; None where there are none either."""
        max_age_s = self._limits.faces_max_age_s
        tracked = self._tracked.at(time_ns)
        if tracked and seconds(time_ns, tracked[0]) <= max_age_s:
            return tracked[1]
        newest = {face_id: of_face.at(time_ns) for face_id, of_face in self._expressions.items()}
        return frozenset(f for f, seen in newest.items() if seen and seconds(time_ns, seen[0]) <= max_age_s) or None

    def expression_of(self, face_id: str, time_ns: int) -> tuple[Expression | None, tuple[str, ...]]:
        """The expression to be used, or why there is none."""
        if not face_id:
            return None, ()
        limits = self._limits
        of_face = self._expressions.get(face_id)
        newest = of_face.at(time_ns) if of_face else None
        if newest is None:
            return None, (f"the expression of face {face_id} is missing",)
        age_s, expression = seconds(time_ns, newest[0]), newest[1]
        if age_s > limits.expression_max_age_s:
            return None, (f"the expression of face {face_id} is stale: {age_s:.1f} s old",)
        if not expression.word:
            return None, (f"the expression of face {face_id} is empty",)
        if expression.confidence < limits.min_expression_confidence:
            told = f"confidence {expression.confidence:.2f} is below {limits.min_expression_confidence:g}"
            return None, (f"the expression of face {face_id}, '{expression.word}', is left out: {told}",)
        return expression, ()
