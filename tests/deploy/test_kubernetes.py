"""The manifests for Kubernetes are valid, and agree with each other and with the service's settings.

The operators' own resources (KubeRay's, CloudNativePG's, Prometheus') have no schema here; Ray's pods do.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import typer
import yaml
from fvs_service.environment import variables_of
from fvs_service.settings import Settings

from fvs_engine.cli.app import app

pytestmark = pytest.mark.process

_DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
_OLDEST_KUBERNETES = "1.30"
_BY_OPERATORS = {"RayCluster", "Cluster", "ServiceMonitor"}
_SECRETS = {
    "blobs": {"access-key-id", "secret-access-key"},
    "database-app": {"uri"},  # by CloudNativePG
    "metrics-key": {"key"},
    "proxy-tls": {"tls.crt", "tls.key"},
    "ray": {"auth_token"},  # by KubeRay
}

Document = dict[str, Any]


def _rendered(folder: Path) -> list[Document]:
    kubectl = Path(sys.executable).parent / "kubectl"
    shown = subprocess.run([kubectl, "kustomize", folder], check=True, capture_output=True, text=True)
    return list(yaml.safe_load_all(shown.stdout))


@pytest.fixture(scope="module")
def manifests(tmp_path_factory: pytest.TempPathFactory) -> list[Document]:
    """All of them: with the components that are not used as it is."""
    folder = shutil.copytree(_DEPLOY, tmp_path_factory.mktemp("deploy") / "deploy") / "kubernetes"
    file = folder / "kustomization.yaml"
    shown = file.read_text(encoding="utf-8")
    file.write_text(shown.replace("# - monitoring", "- monitoring"), encoding="utf-8")
    return _rendered(folder)


def _of_kind(manifests: list[Document], *kinds: str) -> dict[str, Document]:
    return {document["metadata"]["name"]: document for document in manifests if document["kind"] in kinds}


def _pods(manifests: list[Document]) -> dict[str, Document]:
    """The templates of all pods, with the labels that operators give to theirs."""
    pods = {
        name: document["spec"]["template"] for name, document in _of_kind(manifests, "Deployment").items()
    }
    for name, cluster in _of_kind(manifests, "RayCluster").items():
        groups = [("head", cluster["spec"]["headGroupSpec"])]
        groups += [("worker", group) for group in cluster["spec"]["workerGroupSpecs"]]
        for kind, group in groups:
            labels = {"ray.io/cluster": name, "ray.io/node-type": kind}
            template = {**group["template"], "metadata": {"labels": labels}}
            pods[f"{name}-{group.get('groupName', kind)}"] = template
    return pods


def _selected(pods: dict[str, Document], selector: Document) -> list[Document]:
    wanted = selector.get("matchLabels", selector).items()
    return [pod for pod in pods.values() if wanted <= pod["metadata"]["labels"].items()]


def _container(pod: Document) -> Document:
    (container,) = pod["spec"]["containers"]
    return container


def _ports(pod: Document) -> dict[str, int]:
    return {port["name"]: port["containerPort"] for port in _container(pod).get("ports", ())}


def _all_under(document: object, name: str) -> Iterator[Any]:
    """The values of a key, wherever they are."""
    if isinstance(document, dict):
        for key, value in document.items():
            if key == name:
                yield value
            yield from _all_under(value, name)
    elif isinstance(document, list):
        for item in document:
            yield from _all_under(item, name)


@pytest.mark.parametrize("version", [_OLDEST_KUBERNETES, kubernetes_validate.latest_version()])
def test_manifests_are_valid(version: str, manifests: list[Document]) -> None:
    for document in manifests:
        if document["kind"] not in _BY_OPERATORS:
            kubernetes_validate.validate(document, version, strict=True)
    for name, pod in _pods(manifests).items():
        template = {"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": name}, "template": pod}
        kubernetes_validate.validate(template, version, strict=True)
        _container(pod)["misspelt"] = 1
        with pytest.raises(kubernetes_validate.ValidationError):
            kubernetes_validate.validate(template, version, strict=True)
        del _container(pod)["misspelt"]


def test_what_is_applied_lacks_only_monitoring(manifests: list[Document]) -> None:
    applied = _rendered(_DEPLOY / "kubernetes")
    lacking = [document["kind"] for document in manifests if document not in applied]
    assert sorted(lacking) == ["NetworkPolicy", "ServiceMonitor"]
    assert len(applied) == len(manifests) - 2


def test_references_exist(manifests: list[Document]) -> None:
    configurations = _of_kind(manifests, "ConfigMap")
    for name in _all_under(manifests, "configMapRef"):
        assert name["name"] in configurations
    for volume in _all_under(manifests, "configMap"):
        assert volume["name"] in configurations
    for reference in _all_under(manifests, "secretKeyRef"):
        assert reference["key"] in _SECRETS[reference["name"]]
    for credentials in _all_under(manifests, "credentials"):
        assert credentials["key"] in _SECRETS[credentials["name"]]
    for secret in _all_under(manifests, "secret"):
        if "secretName" in secret:
            assert secret["secretName"] in _SECRETS
        else:
            assert {item["key"] for item in secret["items"]} <= _SECRETS[secret["name"]]
    assert "ray" in _of_kind(manifests, "RayCluster")
    assert "database" in _of_kind(manifests, "Cluster")
    texts = [
        file.read_text(encoding="utf-8") for file in (_DEPLOY / "kubernetes").rglob("kustomization.yaml")
    ]
    assert all(f"`{name}`" in "".join(texts) for name in _SECRETS)


def test_volumes_and_files_of_secrets_are_there(manifests: list[Document]) -> None:
    for pod in _pods(manifests).values():
        volumes = {volume["name"]: volume for volume in pod["spec"]["volumes"]}
        mounts = _container(pod)["volumeMounts"]
        assert {mount["name"] for mount in mounts} == set(volumes)
        there = {
            f"{mount['mountPath']}/{item['path']}"
            for mount in mounts
            for items in _all_under(volumes[mount["name"]], "items")
            for item in items
        }
        files = {
            entry["value"] for entry in _container(pod).get("env", ()) if entry["name"].endswith("_FILE")
        }
        assert files == there


def test_selectors_match(manifests: list[Document]) -> None:
    pods = _pods(manifests)
    for name, deployment in _of_kind(manifests, "Deployment").items():
        assert _selected(pods, deployment["spec"]["selector"]) == [pods[name]]
        for spread in deployment["spec"]["template"]["spec"].get("topologySpreadConstraints", ()):
            assert _selected(pods, spread["labelSelector"]) == [pods[name]]
    for kind in ("Service", "PodDisruptionBudget"):
        for name, document in _of_kind(manifests, kind).items():
            assert _selected(pods, document["spec"]["selector"]) == [pods[name]]
    services = _of_kind(manifests, "Service").values()
    for monitor in _of_kind(manifests, "ServiceMonitor").values():
        wanted = monitor["spec"]["selector"]["matchLabels"].items()
        (service,) = (
            service for service in services if wanted <= service["metadata"].get("labels", {}).items()
        )
        assert {endpoint["port"] for endpoint in monitor["spec"]["endpoints"]} <= {
            port["name"] for port in service["spec"]["ports"]
        }


def test_policies_let_through_what_exists(manifests: list[Document]) -> None:
    pods = _pods(manifests)
    pods["database"] = {
        "metadata": {"labels": {"cnpg.io/cluster": "database"}},
        "spec": {"containers": [{"ports": [{"name": "postgresql", "containerPort": 5432}]}]},
    }
    for policy in _of_kind(manifests, "NetworkPolicy").values():
        reached = _selected(pods, policy["spec"]["podSelector"])
        assert reached
        for rule in policy["spec"].get("ingress", ()):
            for peer in rule.get("from", ()):
                assert "namespaceSelector" in peer or _selected(pods, peer["podSelector"])
            named = [port["port"] for port in rule.get("ports", ()) if isinstance(port["port"], str)]
            assert all(set(named) <= set(_ports(pod)) for pod in reached)
    runners = _of_kind(manifests, "NetworkPolicy")["ray-worker"]["spec"]["ingress"][1]["ports"]
    assert runners == [{"port": 32768, "endPort": 60999}]  # net.ipv4.ip_local_port_range, unless it is set
    assert _of_kind(manifests, "NetworkPolicy")["nobody"]["spec"]["podSelector"] == {}


def test_ports_agree(manifests: list[Document]) -> None:
    pods, services = _pods(manifests), _of_kind(manifests, "Service")
    environment = {
        name: {entry["name"]: entry.get("value") for entry in _container(pod).get("env", ())}
        for name, pod in pods.items()
    }
    for name, service in services.items():
        for port in service["spec"]["ports"]:
            assert port["targetPort"] in _ports(pods[name])
    gateway = _ports(pods["gateway"])
    assert environment["gateway"]["FVS_PORT"] == str(gateway["http"])
    assert environment["gateway"]["FVS_GRPC_PORT"] == str(gateway["grpc"])
    assert services["gateway"]["spec"]["clusterIP"] == "None"  # its ports are then those of the pods
    assert {port["name"]: port["port"] for port in services["gateway"]["spec"]["ports"]} == gateway
    assert environment["proxy"]["PROXY_REST"] == f"gateway {gateway['http']}"
    assert environment["proxy"]["PROXY_GRPC"] == f"gateway {gateway['grpc']}"
    assert environment["proxy"]["PROXY_HTTPS_PORT"] == str(_ports(pods["proxy"])["https"])
    client = _ports(pods["ray-head"])["client"]
    assert environment["worker"]["FVS_CLUSTER"] == f"ray://ray-head-svc:{client}"
    for pod in (pods["gateway"], pods["proxy"]):
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            for check in ("httpGet", "tcpSocket"):
                assert all(
                    asked["port"] in _ports(pod) for asked in _all_under(_container(pod).get(probe), check)
                )


def test_nodes_of_ray_are_watched(manifests: list[Document]) -> None:
    (cluster,) = _of_kind(manifests, "RayCluster").values()
    head, groups = cluster["spec"]["headGroupSpec"], cluster["spec"]["workerGroupSpecs"]
    watched = [(head, _ports(_pods(manifests)["ray-head"])["gcs-server"])]
    watched += [(group, int(group["rayStartParams"]["node-manager-port"])) for group in groups]
    for group, port in watched:
        container = _container(group["template"])
        assert {container[probe]["grpc"]["port"] for probe in ("livenessProbe", "readinessProbe")} == {port}
    assert head["rayStartParams"]["num-cpus"] == "0"
    for group in groups:
        resources = _container(group["template"])["resources"]
        assert resources["limits"].items() - resources["requests"].items() == {("ephemeral-storage", "100Gi")}
        assert group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]


def test_variables_are_settings(manifests: list[Document]) -> None:
    named = {entry["name"] for entries in _all_under(manifests, "env") for entry in entries}
    configurations = _of_kind(manifests, "ConfigMap").values()
    named |= {name for document in configurations for name in document["data"]}
    ours = {name.removesuffix("_FILE") for name in named if name.startswith("FVS_")}
    assert ours <= set(variables_of(Settings))
    proxy = (_DEPLOY / "proxy" / "Caddyfile").read_text(encoding="utf-8")
    assert {name for name in named if name.startswith("PROXY_")} <= set(re.findall(r"{\$(\w+)", proxy))


def test_nodes_have_the_version_of_ray_that_is_installed(manifests: list[Document]) -> None:
    (cluster,) = _of_kind(manifests, "RayCluster").values()
    project = (_DEPLOY.parent / "pyproject.toml").read_text(encoding="utf-8")
    pinned = set(re.findall(r'"ray(?:\[\w+\])?==([\d.]+)"', project))
    assert pinned == {cluster["spec"]["rayVersion"]}


def test_commands_exist(manifests: list[Document]) -> None:
    for name in ("gateway", "worker"):
        words = _container(_pods(manifests)[name])["args"]
        command: Any = typer.main.get_command(app).commands[words[0]]
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= options
        assert words[words.index("--role") + 1] == name


def test_pods_are_confined(manifests: list[Document]) -> None:
    """As the namespace demands, and on file systems that nobody can write."""
    (namespace,) = _of_kind(manifests, "Namespace").values()
    assert namespace["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"
    (cluster,) = _of_kind(manifests, "RayCluster").values()
    containers = {name: _container(pod)["securityContext"] for name, pod in _pods(manifests).items()}
    containers["autoscaler"] = cluster["spec"]["autoscalerOptions"]["securityContext"]
    for name, context in containers.items():
        assert not context["allowPrivilegeEscalation"]
        assert context["readOnlyRootFilesystem"]
        assert context["capabilities"]["drop"] == ["ALL"]
        assert context["capabilities"].get("add", []) == (["NET_BIND_SERVICE"] if name == "proxy" else [])
    for name, pod in _pods(manifests).items():
        context = pod["spec"]["securityContext"]
        assert context["runAsNonRoot"]
        assert context["runAsUser"] == 10001
        assert context["seccompProfile"] == {"type": "RuntimeDefault"}
        assert not pod["spec"]["enableServiceLinks"]
        assert (
            name == "ray-head" or not pod["spec"]["automountServiceAccountToken"]
        )  # its autoscaler needs it
        assert {"cpu", "memory"} <= _container(pod)["resources"]["requests"].keys()
        assert "memory" in _container(pod)["resources"]["limits"]


def test_gateways_may_drain_and_are_not_evicted_at_once(manifests: list[Document]) -> None:
    assert "FVS_DRAIN_S" not in str(manifests)
    for name in ("gateway", "proxy"):
        deployment = _of_kind(manifests, "Deployment")[name]
        grace_s = deployment["spec"]["template"]["spec"]["terminationGracePeriodSeconds"]
        assert grace_s >= Settings().drain_s + 10
        assert deployment["spec"]["replicas"] == 2
        assert _of_kind(manifests, "PodDisruptionBudget")[name]["spec"]["maxUnavailable"] == 1
