"""Control of a port that another drivecomm program holds: `start` has the server, `stop` is the client."""
