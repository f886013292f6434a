//! What can be asked of a board that runs: the requests of `sch108bex ctl`, as far as a board can do them.

use std::sync::LazyLock;

use plant::Handle;
use plant::control::{
    Applied, COMMANDS, CommandHelp, ControlError, MemoryFault, Power, Request, SensorFault, Steer,
};
use sch108bex::end_cap::RotarySwitches;

use super::{Live, Table};
use crate::emulator::EmulatorError;

/// What the shadow does: shaft and world.
const OF_THE_WORLD: [&str; 10] = [
    "shaft",
    "supply",
    "temperature",
    "light",
    "battery",
    "supply_profile",
    "brown_out",
    "thermal",
    "led_ageing",
    "discharge",
];
/// What the board does, or whoever holds it.
const OF_THE_BOARD: [&str; 7] =
    ["switches", "power", "sensor", "memory", "operating_time", "help", "shutdown"];

static OFFERED: LazyLock<Vec<CommandHelp>> = LazyLock::new(|| {
    let offered = |name: &str| OF_THE_WORLD.contains(&name) || OF_THE_BOARD.contains(&name);
    COMMANDS.iter().filter(|command| offered(command.name)).copied().collect()
});

impl Steer for Live {
    fn steer(&self, request: &Request) -> Result<Option<Applied>, ControlError> {
        request.check()?;
        if matches!(request, Request::Help {}) {
            return Ok(Some(Applied::Commands(&OFFERED)));
        }
        let shadow = &self.shared.shadow;
        let mut table = self.shared.table();
        let name = request.name();
        if OF_THE_WORLD.contains(&name.as_str()) {
            shadow.apply(request)?;
            table.step(shadow).map_err(refused)?;
        } else {
            table.obey(shadow, request, &name)?;
        }
        Ok(None)
    }
}

#[expect(clippy::needless_pass_by_value, reason = "as `map_err` gives it")]
fn refused(error: EmulatorError) -> ControlError {
    ControlError::Value(error.to_string())
}

impl Table {
    /// Does what concerns the board itself.
    fn obey(&mut self, shadow: &Handle, request: &Request, name: &str) -> Result<(), ControlError> {
        match request {
            Request::Switches { switches, .. } => {
                let switches: RotarySwitches =
                    switches.parse().map_err(|error| ControlError::Value(format!("switches: {error}")))?;
                self.stepped.switches = switches.0;
                Ok(())
            }
            Request::Power { state, .. } => self.switch(shadow, *state).map_err(refused),
            Request::Sensor { fault, .. } => self.disturb(shadow, *fault).map_err(refused),
            Request::Memory { fault, .. } => self.spoil(*fault),
            Request::OperatingTime { hours, .. } => self.set_operating_time(*hours),
            _ => Err(ControlError::Value(format!(
                "{name} is nothing that an emulated board can do; {{\"do\":\"help\"}} lists what it can"
            ))),
        }
    }

    fn switch(&mut self, shadow: &Handle, state: Power) -> Result<(), EmulatorError> {
        if matches!(state, Power::Off | Power::Cycle) {
            self.switched_off = true;
            self.look(shadow)?;
        }
        if matches!(state, Power::On | Power::Cycle) {
            self.switched_off = false;
            self.look(shadow)?;
        }
        Ok(())
    }

    fn disturb(&mut self, shadow: &Handle, fault: SensorFault) -> Result<(), EmulatorError> {
        match fault {
            SensorFault::TurnsLost => self.stepped.turns_lost = true,
            SensorFault::Held => self.stepped.sensor_fault = true,
            SensorFault::Off => (self.stepped.sensor_fault, self.stepped.turns_lost) = (false, false),
            // The firmware has one way to a position that is wrong.
            SensorFault::Once | SensorFault::PositionError => {
                let held = std::mem::replace(&mut self.stepped.sensor_fault, true);
                self.step(shadow)?;
                self.stepped.sensor_fault = held;
            }
        }
        self.step(shadow)
    }

    fn set_operating_time(&mut self, hours: f64) -> Result<(), ControlError> {
        /// A hundredth of an hour.
        const STEP_MS: u64 = 36_000;
        if self.stepped.board().is_powered() {
            return Err(ControlError::Value(
                "the operating time can be set only while the board has no power: switch it off first"
                    .to_owned(),
            ));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "0 to 10 000 000, checked"
        )]
        let steps = (hours * 100.0).round() as u64;
        self.stepped.set_operating_time(steps * STEP_MS).map_err(refused)
    }

    fn spoil(&mut self, fault: MemoryFault) -> Result<(), ControlError> {
        let memory = self.stepped.board_mut().memory_mut();
        let mut damage = |at: usize| {
            if let Some(octets) = &mut memory[at] {
                octets[20] ^= 0x10;
            }
        };
        match fault {
            MemoryFault::DamageA => damage(0),
            MemoryFault::DamageB => damage(1),
            MemoryFault::LostAtPowerOn => self.memory_lost = true,
            MemoryFault::Off => self.memory_lost = false,
            MemoryFault::WritesFail | MemoryFault::TornWrite => {
                return Err(ControlError::Value(
                    "the memory of an emulated board takes every write; damage_a, damage_b and lost_at_power_on \
                     are what can be done to it"
                        .to_owned(),
                ));
            }
        }
        Ok(())
    }
}
