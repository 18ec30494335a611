"""The application and its commands."""

from __future__ import annotations

import click

from drivecomm.cli.commands import LazyGroup
from drivecomm.version import __version__

COMMANDS = {
    "demo": ("demo.tour:demo", "Tour everything on virtual lines in a few seconds, or on a real line with --port."),
    "protocols": ("telegrams:protocols", "List the installed protocols with their defaults and models."),
    "decode": ("telegrams:decode", "Decode one telegram."),
    "encode": ("telegrams:encode", "Build one telegram from its fields and print it in hexadecimal."),
    "scan": ("scan:scan", "Find the drives on a line."),
    "doctor": ("doctor:doctor", "Examine a port and its line, and suggest fixes for problems."),
    "tune": ("tune:tune", "Find the shortest pause after a drive's replies, and its reply time-out."),
    "prove": (
        "prove:prove",
        "Compare a drive with its model, and report the facts that agree, those that contradict, and new ones.",
    ),
    "stats": ("stats:stats", "Poll drives for a while and count replies, errors and reply times."),
    "read": ("one_drive:read", "Read parameters."),
    "write": ("one_drive:write", "Write a parameter."),
    "status": ("status:status", "Show the state of a drive, of a group, or of all drives of the plant."),
    "start": ("start:start", "Start the motor."),
    "stop": ("stop.command:stop", "Stop one motor or several, or with --all every motor."),
    "reset": ("one_drive:reset", "Acknowledge a fault."),
    "reference": ("one_drive:reference", "Set the reference."),
    "wait": ("one_drive:wait", "Wait until a drive reaches a state."),
    "call": ("one_drive:call", "Call a function that only this protocol has, such as jog."),
    "backup": ("parameter_sets.saved:backup", "Save the parameters of a drive to a file."),
    "compare": ("parameter_sets.saved:compare", "List the parameters in which two drives or files differ."),
    "restore": ("parameter_sets.restore:restore", "Write the parameters in a file to a drive."),
    "replace": ("replace:replace", "Restore the approved settings of a drive to its replacement, then compare."),
    "baseline": ("", "The approved parameters of each drive of a plant: accept or show them."),
    "baseline accept": ("baseline:accept", "Make the present parameters of a drive, or a file, its approved set."),
    "baseline show": ("baseline:show", "Show which drives have an approved set: by whom, when and why."),
    "drift": ("drift:drift", "List the differences between the drives of a plant and their approved sets."),
    "report": (
        "report:report",
        "Print the commissioning record of a drive: identity, motor, link loss, settings other than the factory's.",
    ),
    "poll": ("poll:poll", "Read parameters periodically."),
    "watch": ("watch.command:watch", "Watch drives on a live screen in the terminal."),
    "plot": ("plot:plot", "Plot a log or a history."),
    "history": (
        "history:history",
        "Show the record of a server: values, events, commands, and the drives' own fault logs.",
    ),
    "forecast": (
        "forecast:forecast",
        "Estimate how long a round of a poll plan takes.",
    ),
    "cohabit": ("cohabit:cohabit", "Check whether drives on one line can mistake each other's telegrams."),
    "alarms": ("", "Alarms of a plant that drivecomm serve runs."),
    "alarms list": ("standing_alarms:list_alarms", "List the active alarms of a running server."),
    "alarms acknowledge": ("standing_alarms:acknowledge", "Acknowledge alarms of a running server by their ids."),
    "alarms check": ("alarms:check", "Describe the alarms of a plant file in words, or test one."),
    "simulate": ("simulate:simulate", "Serve virtual drives to other programs."),
    "serve": (
        "serve:serve",
        "Own the lines of a plant, and serve its drives to commands, programs and people.",
    ),
    "tags": ("", "Names of a plant's values in supervisory systems: export or import a table of tags."),
    "tags export": (
        "tags:export",
        "Write each value that a server of the plant polls, with its tag and its address at each door, as CSV.",
    ),
    "tags import": (
        "tags:import_tags",
        "Set names, groups and deadbands of values in the plant file; its comments stay.",
    ),
    "fleet": ("", "Many plants through their MQTT broker: present state and record."),
    "fleet show": ("fleet:fleet", "Show the plants whose servers publish to an MQTT broker."),
    "fleet history": ("fleet_past:history", "Show values, events or commands of a plant from the record of its fleet."),
    "fleet alarms": ("fleet_past:alarms", "Show the alarms of all plants from the record of their fleet."),
    "fleet acknowledge": ("fleet_acknowledge:acknowledge", "Acknowledge alarms of a plant, as its server allows."),
    "fleet record": ("fleet_record:record", "Record the plants of a broker in PostgreSQL, or in a file."),
    "replay": ("replay:replay", "Replay a capture: with --listen as its drives, otherwise as its master."),
    "sniff": ("sniff.command:sniff", "Listen to a line without ever sending, or read a capture."),
    "plant": ("", "Control the virtual drives of drivecomm simulate."),
    "plant trip": ("plant:trip", "Make a drive trip."),
    "plant power": ("plant:power", "Switch a drive's power off or on."),
    "plant set": ("plant:set_value", "Set a parameter of a drive, as if at its keypad."),
    "plant inject": ("plant:inject", "Inject foreign bytes into a line."),
    "plant fault": ("plant:fault", "Add a fault to the script of a running plant."),
    "plant show": ("plant:show", "Show the states of all drives, or parameter values of one."),
    "plant telegrams": ("plant_evidence:telegrams", "Show the telegrams on a line, decoded."),
    "plant violations": ("plant_evidence:violations", "Show the rule violations of a line's master."),
    "plant counters": ("plant_evidence:counters", "Show the counters of telegrams, faults and violations."),
    "plant state": ("plant_evidence:state", "Show the present state of each drive: motor, reference, line settings."),
    "models": ("", "Drive models: list, show, check or make them."),
    "models list": ("models.show:list_models", "List the models by protocol."),
    "models show": ("models.show:show", "Show the facts of a drive series."),
    "models setup": (
        "models.setup:setup",
        "Show the panel settings that a drive needs to communicate and to obey commands.",
    ),
    "models check": ("models.show:check", "Check model files."),
    "models names": ("models.show:names", "List the common names with their meaning on every drive, and their unit."),
    "models draw": ("models.draw:draw", "Draw facts at random, each with its source page."),
    "models apply-proof": (
        "models.apply_proof:apply",
        "Mark facts of a model as shown or contradicted by a drive, from a report of prove.",
    ),
    "models import": (
        "models.import_file:import_file",
        "Make a model from a register list, or from the configuration of another program.",
    ),
    "models grow": ("models.grow:grow", "Write a model file from the answers of a drive."),
    "judge": (
        "judge:judge",
        "Judge a master: run any program against a virtual drive through a catalogue of faults.",
    ),
    "conformance": ("package_tests:conformance", "Run the conformance tests of a protocol package."),
    "users": ("", "Users with access to a served plant over a network: add, list or remove."),
    "users add": ("users:add", "Add a user, and print the user's access token; it is shown only once."),
    "users list": ("users:list_users", "List the users with their roles and kinds of credentials."),
    "users remove": ("users:remove", "Remove a user; a running server refuses them from then on."),
    "vectors": ("", "Test vectors: run them, or make them from a capture."),
    "vectors check": ("package_tests:check", "Run every check of every vector."),
    "vectors from-capture": ("package_tests:from_capture", "Turn a capture into vectors."),
}
"""Commands by name: the location, empty for a group, and the summary, with which the docstring there begins as well."""

READING = frozenset(
    {
        *("protocols", "decode", "encode", "scan", "doctor", "stats", "read", "status", "wait", "compare", "poll"),
        *(
            "drift",
            "forecast",
            "cohabit",
            "replay",
            "sniff",
            "judge",
            "conformance",
            "models",
            "vectors",
            "demo",
            "history",
            "fleet",
        ),
    }
)
"""Commands that only print: they end when their output cannot be written. All others complete their work."""


@click.group(
    cls=LazyGroup,
    no_args_is_help=True,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 120,
        "show_default": True,
    },
)
@click.version_option(__version__, message="drivecomm %(version)s", help="Print the version and exit.")
def app() -> None:
    """Variable-frequency drives of different makers over serial lines: scan, read, write, command, simulate."""


OTHERWISE = {"fleet": "show"}
"""Default command of a group, used if the first word is not a command of the group."""

app.add_lazy(COMMANDS, OTHERWISE)
