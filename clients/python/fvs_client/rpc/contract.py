"""The messages and methods of `fvs.v1`, from the descriptors that `make generate` writes.

They are in a pool of their own, so that a program can have other versions of them besides.
"""

from functools import cache
from importlib.resources import files
from typing import Any

from google.protobuf.descriptor import MethodDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

PACKAGE = "fvs.v1"


@cache
def _pool() -> DescriptorPool:
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString((files(__package__) / "contract.binpb").read_bytes()).file:
        pool.Add(file)
    return pool


@cache
def message(name: str) -> Any:
    """The class of a message: ``message("Scene")``."""
    return GetMessageClass(_pool().FindMessageTypeByName(f"{PACKAGE}.{name}"))


@cache
def method(service: str, name: str) -> MethodDescriptor:
    """A method: ``method("SceneService", "GetScene")``; it has ``input_type`` and ``output_type``."""
    return _pool().FindMethodByName(f"{PACKAGE}.{service}.{name}")
