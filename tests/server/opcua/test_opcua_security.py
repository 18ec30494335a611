"""Protection of the OPC UA door: against strangers, between sessions, and from unsafe defaults of the library."""

import asyncio
import pkgutil
import shutil
import subprocess
import tomllib
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import x509_from_der
from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from served_opcua import PASSWORDS, call, lock, node, opened, reads_good, until

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server.opcua import limits, opcua_door
from drivecomm.server.opcua.trusted import TrustedClients
from drivecomm.tomlfile import TomlTable

pytestmark = pytest.mark.soak

STATE = "drives/pump/Status/State"


def table(**content):
    return TomlTable({"kind": "opcua", **content}, "hall.toml", name="door 1")


@asynccontextmanager
async def channel(url):
    """Open a channel without encryption and without a session; yield the client."""
    client = Client(url, timeout=4)
    await client.connect_socket()
    try:
        await client.send_hello()
        await client.open_secure_channel()
        yield client
    finally:
        with suppress(Exception):
            client.disconnect_socket()


def set_clock(client, by):
    """Shift the times of a client's requests; return a function that undoes this."""
    protocol = client.uaclient.protocol
    begun = protocol._setup_request_header

    def wrong(header, *given, **more):
        begun(header, *given, **more)
        header.Timestamp = datetime.now(UTC) + by

    protocol._setup_request_header = wrong
    return lambda: setattr(protocol, "_setup_request_header", begun)


def certificate_of(name, folder, *options):
    """Make a certificate and its key; return the paths of both. options: further options of openssl."""
    files = folder / f"{name}.pem", folder / f"{name}-key.pem"
    names = f"subjectAltName=URI:urn:{name},DNS:localhost,IP:127.0.0.1"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}",
         "-addext", names, "-out", files[0], "-keyout", files[1], *options],
        check=True, capture_output=True,
    )  # fmt: skip
    return tuple(map(str, files))


def revoking(authority, issued, encoding):
    """Return a revocation list of an authority for an issued certificate."""
    shown, key = (Path(each).read_bytes() for each in authority)
    number = x509.load_pem_x509_certificate(Path(issued[0]).read_bytes()).serial_number
    today = datetime.now(UTC)
    revoked = x509.RevokedCertificateBuilder().serial_number(number).revocation_date(today).build()
    made = x509.CertificateRevocationListBuilder(
        issuer_name=x509.load_pem_x509_certificate(shown).subject,
        last_update=today, next_update=today + timedelta(days=1), revoked_certificates=[revoked],
    )  # fmt: skip
    return made.sign(load_pem_private_key(key, None), SHA256()).public_bytes(encoding)


@pytest.fixture
def certificates(tmp_path):
    if not shutil.which("openssl"):
        pytest.skip("openssl is not installed")
    return [certificate_of(name, tmp_path) for name in ("server", "client")]


def test_opcua_door_has_its_entry_point():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert pkgutil.resolve_name(project["entry-points"]["drivecomm.doors"]["opcua"]) is opcua_door


def test_missing_package_is_reported_with_its_install_command(monkeypatch):
    monkeypatch.setattr("drivecomm.server.opcua.door.find_spec", lambda _: None)
    with pytest.raises(UsageError, match=r"install drivecomm\[opcua\]"):
        opcua_door(table())


def test_opcua_door_listens_on_loopback_by_default():
    assert opcua_door(table()).name == "opcua 127.0.0.1:4840"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"listen": "4840"}, 'write an address and a port, such as "127.0.0.1:4840"'),
        ({"listen": "127.0.0.1:99999"}, "write an address and a port"),
        ({"lisen": "127.0.0.1:80"}, "did you mean 'listen'?"),
        ({"certificate": "c.pem"}, "write both certificate = and key ="),
        ({"anonymous": "operate"}, 'write "view" or "nobody"'),
        ({"trusted": "clients"}, "write certificate = and key ="),
    ],
)
def test_invalid_opcua_table_is_refused(content, text):
    with pytest.raises(FileFormatError) as caught:
        opcua_door(table(**content))
    assert text in str(caught.value)
    assert str(caught.value).startswith("hall.toml: door 1: ")


@pytest.mark.parametrize("listen", ["0.0.0.0:0", "[::]:0", "192.168.1.2:0", "plant.example:0"])
def test_network_address_needs_a_certificate_and_users(listen, certificates):
    with pytest.raises(FileFormatError, match=r"certificate = and key =, .*, or set insecure = true"):
        opcua_door(table(listen=listen))
    certificate, key = certificates[0]
    door = opcua_door(table(listen=listen, certificate=certificate, key=key))

    class Plant:
        users = None

    with pytest.raises(UsageError, match=r'write users = "users\.toml" in \[server\]'):
        asyncio.run(door.run(Plant(), lambda: None))


def test_invalid_certificate_or_key_is_refused(tmp_path, certificates):
    class Plant:
        users = object()

    (tmp_path / "c.pem").write_text("x")
    other = opcua_door(table(listen="127.0.0.1:0", certificate=certificates[0][0], key=certificates[1][1]))
    with pytest.raises(UsageError, match="is not the key of"):
        asyncio.run(other.run(Plant(), lambda: None))
    none = opcua_door(table(listen="127.0.0.1:0", certificate=str(tmp_path / "c.pem"), key=str(tmp_path / "c.pem")))
    with pytest.raises(UsageError, match="cannot be used"):
        asyncio.run(none.run(Plant(), lambda: None))


def test_login_without_a_valid_name_and_password_is_refused(door):
    async def test(one):
        for name, password in (("admin", "admin"), ("admin", ""), ("Admin", "x"), ("otto", "wrong"), ("otto", "")):
            with pytest.raises((ua.uaerrors.BadUserAccessDenied, ua.uaerrors.BadIdentityTokenInvalid)):
                async with one.client(name, password):
                    pass
        with pytest.raises(ua.uaerrors.BadIdentityTokenRejected):
            async with one.client():
                pass

    door.run(test)


def test_password_attempts_are_rate_limited(tmp_path):
    async def test():
        async with opened(tmp_path) as one:
            # The clock stands still, since a login may take long here.
            one.plant.users._clock = lambda: 1000.0
            for _ in range(6):
                with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                    async with one.client("olga", "wrong"):
                        pass
            # The correct password has to wait as well; other users do not.
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                async with one.client("olga"):
                    pass
            async with one.client("otto") as otto:
                await reads_good(otto, STATE)

    asyncio.run(test())


def test_anonymous_callers_may_only_view(tmp_path):
    async def test():
        async with opened(tmp_path, anonymous="view") as one, one.client() as client:
            await reads_good(client, STATE)
            for method in ("Stop", "Start", "Coast"):
                assert (await call(client, method))[0] == "BadUserAccessDenied"
            assert (await call(client, "StopAll", on="plant"))[0] == "BadUserAccessDenied"
            assert (await call(client, "InitLock", "x", on="drives/pump/Lock"))[1][0] == -2
            with pytest.raises(ua.uaerrors.BadNotWritable):
                await node(client, STATE).write_value("running")
            assert not one.core.audit.stops

    asyncio.run(test())


def test_no_node_is_writable(door):
    async def test(one):
        async with one.client("carl") as carl:
            # asyncua by default lets every user write these nodes.
            enabled = carl.get_node(ua.ObjectIds.Server_ServerDiagnostics_EnabledFlag)
            for written in (node(carl, STATE), enabled):
                with pytest.raises(ua.uaerrors.BadNotWritable):
                    await written.write_value(True)
            for attribute in (ua.AttributeIds.AccessLevel, ua.AttributeIds.DisplayName):
                with pytest.raises(ua.uaerrors.BadNotWritable):
                    await node(carl, STATE).write_attribute(attribute, ua.DataValue(ua.Variant(3, ua.VariantType.Byte)))

    door.run(test)


def test_clients_cannot_add_or_delete_nodes(door):
    async def test(one):
        async with one.client("carl") as carl:
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await carl.nodes.objects.add_object(2, "mine")
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await carl.delete_nodes([node(carl, "drives/pump")])
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await node(carl, "plant").add_reference(node(carl, "drives/pump"), ua.ObjectIds.Organizes)
            await reads_good(carl, STATE)

    door.run(test)


def test_clients_cannot_register_another_server(door):
    async def test(one):
        async with channel(one.url) as client:
            with pytest.raises(ua.uaerrors.BadSessionNotActivated):
                await client.uaclient.register_server(ua.RegisteredServer(ServerUri="urn:evil"))
        async with one.client("carl") as carl:
            with pytest.raises(ua.uaerrors.BadServiceUnsupported):
                await carl.uaclient.register_server(ua.RegisteredServer(ServerUri="urn:evil"))
            assert [each.ApplicationUri for each in await carl.find_servers()] != ["urn:evil"]

    door.run(test)


def test_session_cannot_be_taken_over_by_another_connection(door):
    async def test(one):
        async with one.client("otto") as otto, channel(one.url) as thief:
            await lock(otto)
            # asyncua numbers its session tokens, so they can be guessed.
            thief.uaclient.session.restore_authentication_token(otto.uaclient.session.authentication_token)
            params = ua.ActivateSessionParameters(
                UserIdentityToken=ua.UserNameIdentityToken(PolicyId="username", UserName="otto", Password=b"wrong")
            )
            with pytest.raises(ua.uaerrors.BadSessionIdInvalid):
                await thief.uaclient.activate_session(params)
            with pytest.raises(ua.uaerrors.BadSessionNotActivated):
                await call(thief, "Start")
            assert await call(otto, "SetReference", 5.0, "%") == ("Good", ["done", ""])

    door.run(test)


def test_second_session_on_a_connection_is_refused(door):
    async def test(one):
        async with one.client("otto") as otto:
            with pytest.raises(ua.uaerrors.BadTooManySessions):
                await otto.uaclient.create_session(ua.CreateSessionParameters(ClientNonce=b"x" * 32))
            await reads_good(otto, STATE)

    door.run(test)


def test_connection_without_a_session_is_closed(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "WITHOUT_SESSION_S", 1.0)

    async def is_closed(client):
        await until(lambda: client.uaclient.protocol is None or client.uaclient.protocol.transport is None)

    async def test():
        async with opened(tmp_path) as one:
            async with channel(one.url) as nobody:
                await is_closed(nobody)
            async with one.client("otto") as otto:
                await asyncio.wait_for(otto.close_session(), 10)
                await is_closed(otto)

    asyncio.run(test())


def test_session_with_subscriptions_ends_with_its_connection(door):
    async def test(one):
        async with one.client("otto") as otto:
            await lock(otto)
            await otto.create_subscription(100, None)
            otto.uaclient.protocol.transport.abort()
            await until(lambda: not one.plant.leases())
            with suppress(Exception):
                await otto.disconnect()

    door.run(test)


def test_client_cannot_use_subscriptions_of_another_session(door):
    async def test(one):
        async with one.client("otto") as otto, one.client("vera") as vera:
            subscription = await otto.create_subscription(100, None)
            number = subscription.subscription_id
            (result,) = await vera.uaclient.delete_subscriptions([number])
            assert result.name == "BadSubscriptionIdInvalid"
            with pytest.raises(ua.uaerrors.BadSubscriptionIdInvalid):
                await vera.uaclient.create_monitored_items(ua.CreateMonitoredItemsParameters(
                    SubscriptionId=number, ItemsToCreate=[ua.MonitoredItemCreateRequest()],
                ))  # fmt: skip
            with pytest.raises(ua.uaerrors.BadServiceUnsupported):
                await vera.uaclient.transfer_subscriptions(ua.TransferSubscriptionsParameters(SubscriptionIds=[number]))
            await subscription.subscribe_data_change(node(otto, STATE))

    door.run(test)


def test_wrong_client_clock_does_not_make_requests_late(door):
    async def test(one):
        client = Client(one.url, timeout=5)
        client.set_user("otto")
        client.set_password(PASSWORDS["otto"])
        await client.connect_socket()
        set_clock(client, timedelta(days=-400))
        await client.send_hello()
        await client.open_secure_channel()
        await client.create_session()
        await client.activate_session(username="otto", password=PASSWORDS["otto"])
        await lock(client)
        assert await call(client, "SetReference", 5.0, "%") == ("Good", ["done", ""])
        await client.close_session()
        client.disconnect_socket()

    door.run(test)


class TestWithACertificate:
    def test_encrypted_connection_is_served(self, tmp_path, certificates):
        async def test():
            (certificate, key), (own, own_key) = certificates
            async with opened(tmp_path, certificate=certificate, key=key) as one:
                client = Client(one.url, timeout=8)
                client.application_uri = "urn:client"
                await client.set_security(SecurityPolicyBasic256Sha256, own, own_key)
                client.set_user("otto")
                client.set_password(PASSWORDS["otto"])
                async with client:
                    await lock(client)
                    assert await call(client, "Start") == ("Good", ["done", ""])
                    await until(lambda: one.runs("pump"))
                    assert await call(client, "Stop") == ("Good", ["done", ""])

        asyncio.run(test())

    def test_unencrypted_connection_is_refused(self, tmp_path, certificates):
        async def test():
            certificate, key = certificates[0]
            async with opened(tmp_path, certificate=certificate, key=key) as one, channel(one.url) as client:
                endpoints = await client.get_endpoints()
                assert {each.SecurityMode for each in endpoints} == {ua.MessageSecurityMode.SignAndEncrypt}
                assert x509_from_der(endpoints[0].ServerCertificate) is not None
                assert endpoints[0].Server.ApplicationUri == "urn:server"
                # asyncua by default would accept an unencrypted session here, without checking rights.
                with pytest.raises(ua.uaerrors.BadSecurityModeInsufficient):
                    await client.create_session()
                with pytest.raises(ua.uaerrors.BadSecurityModeInsufficient):
                    await client.nodes.objects.get_children()

        asyncio.run(test())


class TestTrustedClients:
    @pytest.fixture
    def trusted(self, tmp_path):
        folder = tmp_path / "clients"
        folder.mkdir()
        return folder

    @staticmethod
    @asynccontextmanager
    async def client(one, files, name="client"):
        client = Client(one.url, timeout=8)
        client.application_uri = f"urn:{name}"
        await client.set_security(SecurityPolicyBasic256Sha256, *files)
        client.set_user("otto")
        client.set_password(PASSWORDS["otto"])
        async with client:
            yield client

    def test_client_is_trusted_once_its_certificate_is_moved_to_the_folder(self, tmp_path, trusted, certificates):
        async def test():
            (certificate, key), own = certificates
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                for _ in range(2):
                    with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
                        async with self.client(one, own):
                            pass
                (told,) = [each.text for each in one.core.table.events() if "refused a client" in each.text]
                (kept,) = (trusted / "rejected").iterdir()
                assert "CN=client" in told
                assert f"move {kept} to {trusted}" in told
                kept.rename(trusted / "scada.der")
                async with self.client(one, own) as client:
                    await reads_good(client, STATE)

        asyncio.run(test())

    def test_certificate_issued_by_a_trusted_authority_is_accepted(self, tmp_path, trusted, certificates):
        authority, authority_key = certificate_of("authority", tmp_path, "-addext", "keyUsage=keyCertSign")
        shutil.copy(authority, trusted / "authority.CRT")
        issued = certificate_of("issued", tmp_path, "-CA", authority, "-CAkey", authority_key)

        async def test():
            (certificate, key), own = certificates
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                async with self.client(one, issued, "issued") as client:
                    await reads_good(client, STATE)
                with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
                    async with self.client(one, own):
                        pass

        asyncio.run(test())

    @pytest.mark.parametrize("encoding", [Encoding.PEM, Encoding.DER])
    def test_revoked_certificate_is_refused(self, tmp_path, trusted, certificates, encoding):
        authority = certificate_of("authority", tmp_path, "-addext", "keyUsage=keyCertSign,cRLSign")
        other = certificate_of("other", tmp_path, "-addext", "keyUsage=keyCertSign,cRLSign")
        for each in (authority, other):
            shutil.copy(each[0], trusted)
        issued = certificate_of("issued", tmp_path, "-CA", authority[0], "-CAkey", authority[1])
        (trusted / "other.crl").write_bytes(revoking(other, issued, encoding))

        async def test():
            certificate, key = certificates[0]
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                # A revocation list of another authority has no effect.
                async with self.client(one, issued, "issued") as client:
                    await reads_good(client, STATE)
                (trusted / "authority.crl").write_bytes(revoking(authority, issued, encoding))
                with pytest.raises(ua.uaerrors.BadCertificateRevoked):
                    async with self.client(one, issued, "issued"):
                        pass
                (trusted / "authority.crl").write_bytes(b"half")
                with pytest.raises(ua.uaerrors.BadCertificateRevocationUnknown):
                    async with self.client(one, issued, "issued"):
                        pass

        asyncio.run(test())

    def test_certificate_issued_by_a_trusted_client_is_refused(self, tmp_path, trusted, certificates):
        other, other_key = certificate_of("other", tmp_path, "-addext", "basicConstraints=critical,CA:FALSE")
        shutil.copy(other, trusted)
        issued = certificate_of("issued", tmp_path, "-CA", other, "-CAkey", other_key)

        async def test():
            certificate, key = certificates[0]
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
                    async with self.client(one, issued, "issued"):
                        pass

        asyncio.run(test())

    def test_expired_trusted_certificate_is_refused(self, tmp_path, trusted, certificates):
        over = certificate_of("over", tmp_path)
        certificate = x509.load_pem_x509_certificate(Path(over[0]).read_bytes())
        key = load_pem_private_key(Path(over[1]).read_bytes(), None)
        then, names = datetime.now(UTC) - timedelta(hours=1), certificate.extensions.get_extension_for_class
        made = x509.CertificateBuilder(
            issuer_name=certificate.issuer, subject_name=certificate.subject, public_key=key.public_key(),
            serial_number=1, not_valid_before=then - timedelta(days=1), not_valid_after=then,
            extensions=[names(x509.SubjectAlternativeName)],
        ).sign(key, SHA256())  # fmt: skip
        Path(over[0]).write_bytes(made.public_bytes(Encoding.PEM))
        shutil.copy(over[0], trusted)

        async def test():
            certificate, key = certificates[0]
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                with pytest.raises(ua.uaerrors.BadCertificateTimeInvalid):
                    async with self.client(one, over, "over"):
                        pass

        asyncio.run(test())

    def test_certificate_in_a_request_must_match_the_channel(self, tmp_path, trusted, certificates, monkeypatch):
        known, _ = certificate_of("known", tmp_path)
        shutil.copy(known, trusted)
        shown = x509.load_pem_x509_certificate(Path(known).read_bytes()).public_bytes(Encoding.DER)

        async def test():
            (certificate, key), own = certificates
            async with opened(tmp_path, certificate=certificate, key=key, trusted=str(trusted)) as one:
                asked = ua.CreateSessionParameters

                def with_that_of_another(**given):
                    return asked(**{**given, "ClientCertificate": shown})

                monkeypatch.setattr(ua, "CreateSessionParameters", with_that_of_another)
                with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
                    async with self.client(one, own):
                        pass

        asyncio.run(test())

    def test_number_of_stored_unknown_certificates_is_limited(self, trusted, certificates, tmp_path):
        told = []
        clients = TrustedClients(trusted, told.append)
        for number in range(25):
            key = ["-key", certificates[1][1]]
            files = certificate_of(f"stranger{number}", tmp_path, *key)
            shown = x509.load_pem_x509_certificate(Path(files[0]).read_bytes()).public_bytes(Encoding.DER)
            with pytest.raises(ServiceError):
                asyncio.run(clients.check(shown))
        assert len(told) == len(list((trusted / "rejected").iterdir())) == 20
        for shown in (None, b"", b"\x30\x03abc"):
            with pytest.raises(ServiceError):
                asyncio.run(clients.check(shown))

    def test_invalid_folder_of_trusted_clients_is_refused(self, trusted):
        with pytest.raises(UsageError, match="is not a folder; make it"):
            TrustedClients(trusted / "none", print)
        (trusted / "x.pem").write_text("nothing")
        with pytest.raises(UsageError, match=r"x\.pem is not a certificate of a client"):
            TrustedClients(trusted, print)
        (trusted / "x.pem").rename(trusted / "x.crl")
        with pytest.raises(UsageError, match=r"x\.crl is not a list of revoked certificates"):
            TrustedClients(trusted, print)
