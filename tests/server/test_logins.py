"""Authentication: by token, by password, after a change of the users file, and its rate limit."""

import asyncio
import time

import pytest

from drivecomm.errors import FileFormatError, NotAllowedError
from drivecomm.server import credentials
from drivecomm.server.callers import Caller, Role
from drivecomm.server.credentials import password_hash, token_hash
from drivecomm.server.logins import LOGGED_IN_S, LONGEST_WAIT_S, MOST_LOGINS, Users
from drivecomm.server.users import User, add_user, remove_user


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Make password hashes cheap to compute."""
    monkeypatch.setattr(credentials, "_COST", (2, 1, 1))
    monkeypatch.setattr(credentials, "_MOST_MEMORY", 2**20)


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "users.toml"
    add_user(path, User(name="anna", role=Role.OPERATE, token=token_hash("anna's"), password=password_hash("password")))
    add_user(path, User(name="ben", role=Role.VIEW, token=token_hash("ben's")))
    return path


@pytest.fixture
def told():
    return []


@pytest.fixture
def users(file, clock, told):
    return Users(file, told.append, clock)


def log_in(users, name="anna", password="password"):
    return asyncio.run(users.log_in(name, password))


def test_user_is_authenticated_by_a_token(users):
    assert users.caller("anna's", "http 1") == Caller(name="anna", role=Role.OPERATE, door="http 1")
    assert users.caller("ben's", "http 1").role is Role.VIEW
    for token in ("", "anna's ", "carla's", token_hash("anna's"), "\ud800", "x" * 1_000_000):
        with pytest.raises(NotAllowedError, match="this token is not known, or no longer valid"):
            users.caller(token, "http 1")


def test_login_by_password_is_valid_for_a_limited_time(users, clock):
    login = log_in(users)
    assert abs(login.until_s - time.time() - LOGGED_IN_S) < 60
    assert users.caller(login.token, "http 1") == users.caller("anna's", "http 1")
    clock.now = LOGGED_IN_S - 1
    assert users.caller(login.token, "http 1")
    clock.now = LOGGED_IN_S
    with pytest.raises(NotAllowedError):
        users.caller(login.token, "http 1")


def test_login_can_be_renewed_until_it_expires(users, clock):
    login = asyncio.run(users.log_in("anna", "password"))
    clock.now = LOGGED_IN_S - 1
    assert users.renew(login.token).token == login.token
    clock.now = 2 * LOGGED_IN_S - 2
    assert users.caller(login.token, "opcua x").name == "anna"
    clock.now = 2 * LOGGED_IN_S
    for late in (login.token, "nobody's", "anna's"):
        with pytest.raises(NotAllowedError, match="log in again"):
            users.renew(late)


def test_token_is_invalid_after_logout(users):
    login = log_in(users)
    users.log_out(login.token)
    with pytest.raises(NotAllowedError):
        users.caller(login.token, "http 1")


@pytest.mark.parametrize(("name", "password"), [("anna", "Password"), ("anna", ""), ("ben", ""), ("carla", "password")])
def test_wrong_name_and_wrong_password_give_the_same_error(users, name, password):
    with pytest.raises(NotAllowedError, match=r"^the name or the password is wrong$"):
        log_in(users, name, password)


def test_unknown_name_takes_as_long_as_a_wrong_password(users, monkeypatch):
    tried = []
    monkeypatch.setattr("drivecomm.server.logins.password_fits", lambda *given: tried.append(given) is not None)
    for name in ("carla", "ben"):
        with pytest.raises(NotAllowedError):
            log_in(users, name)
    assert len(tried) == 2


def guess(users, times, name="anna"):
    for _ in range(times):
        with pytest.raises(NotAllowedError, match="name or the password"):
            log_in(users, name, "a guess")


def test_wrong_passwords_lead_to_growing_waits_but_tokens_still_work(users, clock):
    guess(users, 5)
    waits = []
    for _ in range(10):
        begun = clock.now
        with pytest.raises(
            NotAllowedError, match=r"too many wrong passwords for this name; try again in \d+ s, or use"
        ):
            log_in(users)
        assert users.caller("anna's", "http 1").name == "anna"
        while True:
            clock.now += 0.5
            try:
                log_in(users, "anna", "a guess")
            except NotAllowedError as error:
                if "too many" not in str(error):
                    break
        waits.append(clock.now - begun)
    assert waits == [1, 2, 4, 8, 16, 32, 60, 60, 60, 60]
    clock.now += LONGEST_WAIT_S
    assert log_in(users)
    guess(users, 5)


def test_wrong_passwords_of_one_name_do_not_delay_another(users):
    guess(users, 5, "carla")
    assert log_in(users)


def test_failed_logins_are_forgotten_after_15_minutes(users, clock):
    guess(users, 4)
    clock.now += 901
    guess(users, 5)


def test_concurrent_wrong_passwords_are_limited_like_sequential_ones(users):
    async def guesses():
        return await asyncio.gather(*(users.log_in("anna", "a guess") for _ in range(50)), return_exceptions=True)

    said = [str(error) for error in asyncio.run(guesses())]
    assert said.count("the name or the password is wrong") <= 5
    assert {"the name or the password is wrong"} < set(said)


@pytest.mark.soak
def test_number_of_remembered_failed_names_is_limited(users):
    for number in range(3000):
        with pytest.raises(NotAllowedError):
            log_in(users, f"name {number}", "a guess")
    assert len(users._failures) <= 1024


@pytest.mark.soak
def test_number_of_logins_is_limited_per_user(users, file, clock):
    add_user(file, User(name="carla", role=Role.VIEW, password=password_hash("password")))
    clock.now += 2
    first, other = log_in(users), log_in(users, "carla")
    for _ in range(MOST_LOGINS):
        last = log_in(users)
    assert users.caller(other.token, "http")
    assert users.caller(last.token, "http")
    with pytest.raises(NotAllowedError):
        users.caller(first.token, "http")
    assert len(users._logins) == MOST_LOGINS


def test_changed_users_file_takes_effect(users, file, clock):
    login = log_in(users)
    remove_user(file, "ben")
    clock.now += 2
    with pytest.raises(NotAllowedError):
        users.caller("ben's", "http")
    add_user(file, User(name="ben", role=Role.COMMISSION, token=token_hash("ben's")))
    clock.now += 2
    assert users.caller("ben's", "http").role is Role.COMMISSION
    assert users.caller(login.token, "http").name == "anna"


@pytest.mark.parametrize("change", ["removed", "another password", "another role"])
def test_login_follows_changes_of_its_user(users, file, clock, change):
    login = log_in(users)
    password = users._users["anna"].password
    remove_user(file, "anna")
    if change == "another password":
        add_user(file, User(name="anna", role=Role.OPERATE, password=password_hash("password")))
    if change == "another role":
        add_user(file, User(name="anna", role=Role.VIEW, password=password))
    clock.now += 2
    if change == "another role":
        assert users.caller(login.token, "http").role is Role.VIEW
    else:
        with pytest.raises(NotAllowedError):
            users.caller(login.token, "http")


@pytest.mark.parametrize("change", ["broken", "gone"])
def test_unreadable_users_file_leaves_the_known_users_valid(users, file, clock, told, change):
    text = file.read_text()
    if change == "gone":
        file.unlink()
    else:
        file.write_text("[[user]]\nrole = 3\n")
    for _ in range(3):
        clock.now += 2
        assert users.caller("anna's", "http").name == "anna"
    assert len(told) == 1
    assert str(file) in told[0]
    assert told[0].endswith("; the users read before stay valid")
    file.write_text(text)
    file.chmod(0o600)
    clock.now += 2
    assert users.caller("anna's", "http").name == "anna"
    assert told[1:] == [f"{file}: can be read again"]


def test_missing_users_file_is_refused_at_the_start(tmp_path):
    with pytest.raises(FileFormatError, match="there is no such file"):
        Users(tmp_path / "users.toml")
