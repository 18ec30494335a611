//! A master or a drive of the public crate x328-proto, on a line that is its standard input and output.
//!
//!     x328_station master read:11:1040 again:11:1040 write:11:642:385
//!     x328_station drive 11 1040=1 642=0
//!
//! It tells what it reads, and what is written to it, on standard error, a line each. Build it as an example of the
//! crate: copy it to `examples` of cth-oso/rust-x328-proto 0.2.0 and call `cargo build --example x328_station`.

use std::collections::HashMap;
use std::io::{self, Read, Write};

use x328_proto::master::io::Master;
use x328_proto::node::Node;
use x328_proto::{Address, NodeState, Value};

struct Line;

impl Read for Line {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        io::stdin().read(room)
    }
}

impl Write for Line {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        io::stdout().write(data)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush()
    }
}

fn command(orders: impl Iterator<Item = String>) {
    let mut master = Master::new(Line);
    for order in orders {
        let words: Vec<&str> = order.split(':').collect();
        let address: u8 = words[1].parse().unwrap();
        let parameter: i16 = words[2].parse().unwrap();
        let told = match words[0] {
            "read" => master.read_parameter(address, parameter).map(|value| value.to_string()),
            "again" => master.read_parameter_again(address, parameter).map(|value| value.to_string()),
            _ => master
                .write_parameter(address, parameter, words[3].parse::<i32>().unwrap())
                .map(|()| "taken".to_string()),
        };
        match told {
            Ok(text) => eprintln!("{}", text),
            Err(x328_proto::master::io::Error::ProtocolError { source }) => eprintln!("{}", source),
            Err(error) => eprintln!("{}", error),
        }
    }
}

fn answer(address: u8, mut held: HashMap<i16, i32>) {
    let mut node = Node::new(Address::new(address).unwrap());
    let mut token = node.reset();
    loop {
        token = match node.state(token) {
            NodeState::ReceiveData(line) => {
                let mut heard = [0];
                if Line.read(&mut heard).unwrap_or(0) == 0 {
                    return;
                }
                line.receive_data(&heard)
            }
            NodeState::SendData(told) => {
                Line.write_all(told.send_data()).unwrap();
                Line.flush().unwrap();
                told.data_sent()
            }
            NodeState::ReadParameter(asked) => match held.get(&*asked.parameter()) {
                Some(&value) => asked.send_reply_ok(Value::new(value).unwrap()),
                None => asked.send_invalid_parameter(),
            },
            NodeState::WriteParameter(order) => {
                let (parameter, value) = (*order.parameter(), *order.value());
                if !held.contains_key(&parameter) {
                    order.write_error()
                } else {
                    held.insert(parameter, value);
                    eprintln!("{}={}", parameter, value);
                    order.write_ok()
                }
            }
        };
    }
}

fn main() {
    let mut words = std::env::args().skip(1);
    if words.next().unwrap() == "master" {
        command(words);
    } else {
        let address = words.next().unwrap().parse().unwrap();
        let held = words.map(|word| {
            let (parameter, value) = word.split_once('=').unwrap();
            (parameter.parse().unwrap(), value.parse().unwrap())
        });
        answer(address, held.collect());
    }
}
