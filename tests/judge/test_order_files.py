import pytest

from drivecomm.errors import FileFormatError, UsageError
from drivecomm.judge import JudgeOrder, JudgeTask, parse_task, read_order
from drivecomm.protocol import parse_drive

DRIVE = parse_drive("vabus:1,model=agile")


def written(folder, text):
    path = folder / "judge.toml"
    path.write_text(f"format = 1\ndrive = 'vabus:1'\n{text}")
    return path


def test_order_file_defines_drive_command_and_tasks(tmp_path):
    order = read_order(
        written(
            tmp_path,
            'command = ["./mine", "{port}"]\nlimit_s = 5\nseed = 7\nenvironment = { A = "b" }\n'
            '[[task]]\nname = "read"\narguments = ["read", "481"]\nshows = "(?P<value>[0-9]+)"\nscale = 10\n',
        )
    )
    assert order.words(order.tasks[0], "/dev/x") == ["./mine", "/dev/x", "read", "481"]
    assert (order.limit_s, order.seed, order.environment, order.tasks[0].scale) == (5, 7, {"A": "b"}, 10)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('comand = ["x"]', "did you mean 'command'?"),
        ('command = ["x"]', "write {port} where"),
        ("command = [1]", "command is not a list of texts"),
        ('command = ["{port}", "{prot}"]', "unknown placeholder {prot}; did you mean 'port'?"),
        ("limit_s = 0", "invalid limit of 0 s"),
        ('[[task]]\nname = "raed"', "unknown task 'raed'; did you mean 'read'?"),
        ('[[task]]\nname = "read"\nshows = "("', "shows is not a regular expression"),
        ('[[task]]\nname = "read"\nscale = 0', "a scale of 0 shows nothing"),
        ('[[task]]\nname = "read"\n[[task]]\nname = "read"', "the task read is given twice"),
    ],
)
def test_error_names_the_mistake_in_an_order_file(tmp_path, text, said):
    with pytest.raises(FileFormatError, match="line") as caught:
        read_order(written(tmp_path, text))
    assert said in str(caught.value)


def test_placeholders_in_the_command_are_replaced():
    order = JudgeOrder(
        drive=DRIVE, command=("x", "{task}", "{host}", "{tcp_port}"), tasks=(parse_task("read=-r '4 5'"),)
    )
    assert order.words(order.tasks[0], "socket://127.0.0.1:4001") == ["x", "-r", "4 5", "127.0.0.1", "4001"]


def test_value_placeholder_has_a_default():
    order = JudgeOrder(drive=DRIVE, command=("x", "{port}"), tasks=(JudgeTask(name="write", arguments=("{value}",)),))
    assert order.words(order.tasks[0], "p")[-1] == "10"
    assert order.words(order.tasks[0], "p", "12.5")[-1] == "12.5"


def test_order_without_tasks_gets_one_task_named_run():
    assert [task.name for task in JudgeOrder(drive=DRIVE, command=("{port}",)).tasks] == ["run"]


def test_unclosed_quote_in_task_arguments_raises_usage_error():
    with pytest.raises(UsageError, match="cannot be parsed"):
        parse_task("read='481")
