"""The users file: its content, its permissions, and edits that leave the rest unchanged."""

import os

import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.server import credentials
from drivecomm.server.callers import Role
from drivecomm.server.credentials import is_password_hash, new_token, password_fits, password_hash, token_hash
from drivecomm.server.users import User, add_user, read_users, remove_user

HASH = token_hash("a token")
ENTRY = f'[[user]]\nname = "anna"\nrole = "operate"\ntoken = "{HASH}"\n'
POSIX = pytest.mark.skipif(os.name != "posix", reason="Windows has other file permissions")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "users.toml"
    path.write_text(ENTRY)
    path.chmod(0o600)
    return path


def user(name, role=Role.VIEW):
    return User(name=name, role=role, token=token_hash(name))


def test_users_are_read_from_the_file(file):
    assert read_users(file) == (User(name="anna", role=Role.OPERATE, token=HASH),)


def test_adding_and_removing_users_keeps_the_rest_of_the_file(file):
    file.write_text("# ours\n\n" + ENTRY + "# anna is on holiday in May\n")
    add_user(file, user("ben"))
    add_user(file, user("carla", Role.COMMISSION))
    assert [each.name for each in read_users(file)] == ["anna", "ben", "carla"]
    remove_user(file, "ben")
    assert [(each.name, each.role) for each in read_users(file)] == [
        ("anna", Role.OPERATE),
        ("carla", Role.COMMISSION),
    ]
    assert file.read_text().startswith("# ours\n\n" + ENTRY + "# anna is on holiday in May\n")
    remove_user(file, "anna")
    remove_user(file, "carla")
    assert read_users(file) == ()


def test_invalid_addition_or_removal_is_refused(file):
    with pytest.raises(UsageError, match=r"has a user anna already; remove that one first with drivecomm users remove"):
        add_user(file, user("anna"))
    with pytest.raises(UsageError, match=r"has no user 'ann'; did you mean 'anna'\? It has anna"):
        remove_user(file, "ann")
    file.write_text(f'user = [{{ name = "anna", role = "view", token = "{HASH}" }}]')
    with pytest.raises(FileFormatError, match="anna cannot be removed from what is written there; remove the entry by"):
        remove_user(file, "anna")
    assert "anna" in file.read_text()


@POSIX
def test_written_users_file_is_accessible_to_its_owner_only(tmp_path):
    file = tmp_path / "users.toml"
    add_user(file, user("anna"))
    assert file.stat().st_mode & 0o777 == 0o600
    add_user(file, user("ben"))
    remove_user(file, "anna")
    assert file.stat().st_mode & 0o777 == 0o600
    assert not [each for each in tmp_path.iterdir() if each != file]


@pytest.fixture
def owned(file, monkeypatch):
    """Return a function that sets owner and mode of the file, and the user who reads it."""

    def belongs_to(owner, mode, me):
        file.chmod(mode)
        real = file.stat()
        monkeypatch.setattr("pathlib.Path.stat", lambda *_, **__: os.stat_result([*real[:4], owner, *real[5:]]))
        monkeypatch.setattr(os, "geteuid", lambda: me)

    return belongs_to


@POSIX
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o644, 0o666])
def test_users_file_accessible_to_others_is_refused(file, owned, mode):
    owned(1000, mode, 1000)
    for use in (read_users, lambda path: add_user(path, user("ben"))):
        with pytest.raises(FileFormatError, match=f"{file}: others can read or write it; run chmod 600 {file}"):
            use(file)


@POSIX
@pytest.mark.parametrize(
    ("owner", "mode", "me", "sentence"),
    [
        (1000, 0o600, 4711, "belongs to another user"),
        (1000, 0o600, 0, ""),
        (0, 0o600, 0, ""),
        (0, 0o640, 4711, ""),
        (0, 0o640, 0, ""),
        (0, 0o660, 4711, "others can read or write it; run chmod 640"),
        (0, 0o644, 4711, "others can read or write it; run chmod 640"),
    ],
)
def test_users_file_of_another_owner_is_refused_except_of_root(file, owned, *, owner, mode, me, sentence):
    """A file that root gives to a service is readable by the group of the service."""
    owned(owner, mode, me)
    if sentence:
        with pytest.raises(FileFormatError, match=sentence):
            read_users(file)
    else:
        assert read_users(file)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root gives files away")
def test_rewritten_users_file_keeps_owner_group_and_mode(file):
    os.chown(file, 0, 4711)
    file.chmod(0o640)
    add_user(file, user("ben"))
    remove_user(file, "anna")
    found = file.stat()
    assert (found.st_uid, found.st_gid, found.st_mode & 0o777) == (0, 4711, 0o640)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[[user]]\nrole = "view"\n', "line 1: user 1: the key 'name' is missing"),
        ('[[user]]\nname = "a"\n', "line 1: user 1 (a): the key 'role' is missing"),
        ('[[user]]\nname = "a"\nrole = "boss"\n', "line 3: user 1 (a): unknown role 'boss'; use view, operate, com"),
        ('[[user]]\nname = "a"\nrole = "nobody"\n', "line 3: user 1 (a): unknown role 'nobody'"),
        ('[[user]]\nname = "a"\nrole = "view"\n', "line 1: user 1 (a): a has neither a token nor a password"),
        (ENTRY + "passwrod = 3\n", "line 5: user 1 (anna): unknown key 'passwrod'; did you mean 'password'?"),
        (ENTRY + ENTRY, "line 5: user 2 (anna): anna is listed twice"),
        (
            ENTRY.replace("anna", "anonymous"),
            "line 1: user 1 (anonymous): anonymous is reserved for callers without a login",
        ),
        (ENTRY.replace("anna", "a b"), "line 1: user 1 (a b): 'a b' cannot be a user's name"),
        (ENTRY.replace("anna", ""), "line 1: user 1: '' cannot be a user's name"),
        ("user = 3\n", "line 1: invalid user = 3"),
        ("=", "cannot be read as a file of users"),
    ],
)
def test_invalid_users_file_is_refused_with_its_line(file, text, sentence):
    file.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        read_users(file)
    assert str(caught.value).removeprefix(str(file)).lstrip(",: ").startswith(sentence)


@pytest.mark.parametrize("key", ["token", "password"])
@pytest.mark.parametrize("secret", ['"my dog Rex"', "8514", f'"{HASH[:-1]}"', '"scrypt:2:1:1:AAAA:AAAA"'])
def test_error_does_not_repeat_a_misplaced_secret(file, key, secret):
    file.write_text(ENTRY.replace(f'token = "{HASH}"', f"{key} = {secret}"))
    with pytest.raises(FileFormatError, match=r"drivecomm users add") as caught:
        read_users(file)
    assert secret.strip('"') not in str(caught.value)


def test_tokens_are_unique_and_stored_as_hashes():
    assert len({new_token() for _ in range(100)}) == 100
    assert len(new_token()) >= 43
    assert token_hash("a") == "sha256:ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb"
    assert "\ud800" not in token_hash("\ud800")


@pytest.mark.soak
def test_password_fits_only_its_salted_hash():
    known = password_hash("correct horse")
    assert is_password_hash(known)
    assert password_fits("correct horse", known)
    assert not password_fits("Correct horse", known)
    assert not password_fits("", known)
    assert not password_fits("x" * 10_000_000, known)
    assert known != password_hash("correct horse"), "each hash has its own salt"
    assert "horse" not in known


@pytest.mark.parametrize("password", ["", "seven77", "x" * 201])
def test_password_of_invalid_length_is_refused(password):
    with pytest.raises(UsageError, match="a password has 8 to 200 characters"):
        password_hash(password)


def test_password_hash_with_excessive_cost_is_invalid(monkeypatch):
    monkeypatch.setattr(credentials, "_scrypt", lambda *_: b"x" * 32)
    usual = password_hash("correct horse")
    assert is_password_hash(usual)
    for cost in ("1024:8:5", "4194304:8:1", "16384:99:1", "16384:8:99", "16385:8:1", "16384:0:1", "16384:8:0"):
        assert not is_password_hash(usual.replace("16384:8:5", cost)), cost
