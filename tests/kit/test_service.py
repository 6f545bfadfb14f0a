"""A service that cannot work any more says so or ends: a toy service as a real process."""

import signal

import pytest
from processes import DOCKER_STOP_S, poll
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters


def test_what_is_missing_is_said(start):
    """/healthz answers ok while both threads turn; /readyz says in its body what is missing."""
    toy = start("toy_service.py")
    poll(lambda: toy.get("/healthz") == (200, "ok\n"), "alive")
    poll(lambda: toy.get("/readyz") == (503, "not ready: the toy is not wound up\n"), "what is missing")
    assert toy.stop(DOCKER_STOP_S) == 0


def test_a_main_thread_that_hangs_is_not_alive(start):
    """While the main thread does not answer, /healthz is 503 and names it; the port itself still answers."""
    toy = start("toy_service.py")
    poll(
        lambda: toy.get("/readyz")[1] == "not ready: the toy is not wound up\n" and toy.get("/healthz")[0] == 200,
        "alive",
    )
    toy.send(signal.SIGUSR1)
    status, text = poll(lambda: (got := toy.get("/healthz"))[0] != 200 and got, "not alive")
    assert (status, text) == (503, "no answer from: the main thread\n")
    assert toy.get("/metrics")[0] == 200
    toy.kill()


def test_a_thread_that_fails_fails_its_service(start):
    """An exception on a thread ends the process with a traceback and a status that has it restarted."""
    toy = start("toy_service.py", fault="thread")
    assert toy.wait() == 1
    assert "the toy's disk is broken" in toy.log()


@pytest.mark.parametrize("kind", [77, 255])
def test_a_ros_thread_that_ends_ends_the_service(start, ears, kind):
    """A set_parameters request of a type that does not exist breaks rclpy's spin: the service does not live on deaf."""
    toy = start("toy_service.py")
    client = ears.node.create_client(SetParameters, "/toy_service/set_parameters")
    ears.until(client.service_is_ready, "the service is there")
    nonsense = Parameter(name="follow", value=ParameterValue(type=kind))
    client.call_async(SetParameters.Request(parameters=[nonsense]))
    ears.until(lambda: toy.child.poll() is not None, toy.log)
    assert toy.wait() == 1
    assert "The ROS thread has ended" in toy.log()
