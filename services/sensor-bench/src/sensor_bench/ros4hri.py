"""The ROS4HRI side: the topics of hri_face_detect, hri_emotion_recognizer and hri_person_manager, quirks included."""

from builtin_interfaces.msg import Time
from hri_msgs.msg import Expression, IdsList
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sense4hri.service import Service
from std_msgs.msg import String

from sensor_bench.config import BenchConfig
from sensor_bench.scene import Scene

FRAME_INTERVAL_S = 0.1
"""Processed images, and the cycle of the person manager."""
FACES_TRACKED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)
EXPRESSION = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE)
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Ros4Hri:
    """Publishes a `Scene` for as long as the service runs."""

    def __init__(self, service: Service[BenchConfig], scene: Scene) -> None:
        self._service, self._scene = service, scene
        self._faces = service.publisher(IdsList, "/humans/faces/tracked", FACES_TRACKED)
        self._persons = service.publisher(IdsList, "/humans/persons/tracked", LATCHED)
        self._expressions: dict[str, Publisher] = {}
        self._face_ids: dict[str, Publisher] = {}
        self._persons_sent: list[str] | None = None
        service.every(FRAME_INTERVAL_S, self._on_image)
        service.every(service.config.expression_interval_s, self._on_recognition)

    def _now(self) -> Time:
        return self._service.node.get_clock().now().to_msg()

    def _ids(self, ids: list[str]) -> IdsList:
        message = IdsList(ids=ids)
        message.header.stamp = self._now()
        return message

    def _on_image(self) -> None:
        self._faces.publish(self._ids(list(self._scene.visible())))
        owners = self._scene.face_of_person()
        tracked = [person for person, face in owners.items() if face]
        if tracked != self._persons_sent:
            # only when it changes: late volatile subscribers miss it, as with the real one
            self._persons.publish(self._ids(tracked))
            self._persons_sent = tracked
        for person, face in owners.items():
            if person not in self._face_ids:
                topic = f"/humans/persons/{person}/face_id"
                self._face_ids[person] = self._service.publisher(String, topic, LATCHED)
            self._face_ids[person].publish(String(data=face))

    def _on_recognition(self) -> None:
        visible = self._scene.visible()
        for name in set(self._expressions) - set(visible):
            self._service.node.destroy_publisher(self._expressions.pop(name))
        for name, face in visible.items():
            if name not in self._expressions:
                topic = f"/humans/faces/{name}/expression"
                self._expressions[name] = self._service.publisher(Expression, topic, EXPRESSION)
            message = Expression(expression=face.expression, confidence=float(face.confidence))
            if self._service.config.stamp_expressions:
                message.header.stamp = self._now()
            self._expressions[name].publish(message)
