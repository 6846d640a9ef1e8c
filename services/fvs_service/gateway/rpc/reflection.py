"""Server reflection in both of its versions, whose messages are the same on the wire.

``grpcio-reflection`` has only v1alpha. Clients ask for v1 first, and some ask for nothing else.
"""

from collections.abc import Iterable

import grpc
from google.protobuf import descriptor_pool, text_format
from google.protobuf.descriptor import ServiceDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from grpc_reflection.v1alpha.reflection import aio
from grpc_reflection.v1alpha.reflection_pb2 import (
    DESCRIPTOR,
    ServerReflectionRequest,
    ServerReflectionResponse,
)

_SERVICE = "ServerReflection"


def serve_reflection(names: Iterable[str], server: grpc.aio.Server) -> None:
    """Let clients ask ``server`` for the descriptors of the services ``names``, and of reflection."""
    versions = DESCRIPTOR.services_by_name[_SERVICE], _newer_version()
    servicer = aio.ReflectionServicer((*names, *(version.full_name for version in versions)))
    answer = grpc.stream_stream_rpc_method_handler(
        servicer.ServerReflectionInfo,
        ServerReflectionRequest.FromString,
        ServerReflectionResponse.SerializeToString,
    )
    server.add_generic_rpc_handlers(
        tuple(
            grpc.method_handlers_generic_handler(version.full_name, {version.methods[0].name: answer})
            for version in versions
        )
    )


def _newer_version() -> ServiceDescriptor:
    """The service of v1: v1alpha's under another package."""
    older = FileDescriptorProto()
    DESCRIPTOR.CopyToProto(older)
    text = text_format.MessageToString(older).replace("v1alpha", "v1")
    newer = text_format.Parse(text, FileDescriptorProto())
    pool = descriptor_pool.Default()
    pool.AddSerializedFile(newer.SerializeToString())
    return pool.FindServiceByName(f"{newer.package}.{_SERVICE}")
