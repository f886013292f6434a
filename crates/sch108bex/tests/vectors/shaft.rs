//! Vectors about position, preset and motion: through real latches of the sensor half.

use sch108bex::functionality::Functionality;
use sch108bex::parameterization::Parameters;
use sch108bex::preset::PRESET_BIT;
use sch108bex::scaling::Scaling;
use sch108bex::sensor_half::Demand;
use sch108bex::specification::SerialNumber;
use serde_json::Value;

use crate::bench::{Bench, parameters, variant};
use crate::vector::Vector;

/// Categories position and scaling: one latch, one position.
pub(crate) fn position(vector: &Vector) {
    let variant = variant(vector);
    let mut bench = Bench::delivered(variant);
    bench.exchange(Functionality::Class2, parameters(vector, variant));
    bench.latch(vector.number("raw"));
    if vector.int("offset").is_some_and(|offset| offset != 0) {
        vector.fault("offsets are set by a preset only");
    }
    vector.check("position", bench.half.position());
    vector.check_octets("input_octets", &bench.half.inputs().octets[..4]);
    if vector.expects("overflow_residual") {
        vector.check("overflow_residual", bench.half.scaling().overflow_residual());
    }
}

/// Category preset: a latch, the outputs, the same latch again, and another.
pub(crate) fn preset(vector: &Vector) {
    let variant = variant(vector);
    let raw = vector.number("raw");
    let mut bench = Bench::delivered(variant);
    bench.exchange(Functionality::Class2, parameters(vector, variant));
    bench.latch(raw);
    let position_before = bench.half.position();
    let outputs: [u8; 4] = vector.octets("output_octets").try_into().expect("four octets");
    let outputs = u32::from_be_bytes(outputs);
    if outputs & PRESET_BIT == 0 {
        vector.fault("bit 31 is not set");
    }
    bench.obey(Demand::Preset(outputs & !PRESET_BIT));
    let accepted = bench.half.take_record_change();
    bench.latch(raw);
    let mut block = [0; 51];
    bench.half.diagnostics(&SerialNumber::DEFAULT).emit_long(&mut block);
    vector.check("accepted", accepted);
    vector.check("position_before", position_before);
    vector.check("offset", bench.half.offset());
    vector.check_octets("offset_octets_32_35", &block[32 - 7..=35 - 7]);
    vector.check("position_at_preset", bench.half.position());
    if let Some(raw_after) = vector.int("raw_after") {
        bench.latch(raw_after);
        vector.check("position_after", bench.half.position());
    }
}

/// Category velocity: the shaft stands between the samples, so each window's end is seen alone.
pub(crate) fn velocity(vector: &Vector) {
    let variant = variant(vector);
    let window: u64 = vector.number("sample_ms");
    let raws = vector.ints("raw_unwrapped_at_samples");
    let mut bench = Bench::delivered(variant);
    bench.latch(raws[0]);
    bench.exchange(Functionality::Scancon2, parameters(vector, variant));
    let (mut velocities, mut accelerations) = (Vec::new(), Vec::new());
    for (index, raw) in raws.iter().enumerate() {
        bench.latch(*raw);
        let image = *bench.half.inputs();
        match index {
            0 if (image.velocity(), image.acceleration()) != (0, 0) => {
                vector.fault("there is motion before the first full window");
            }
            0 => {}
            1 if image.acceleration() != 0 => vector.fault("acceleration before two windows"),
            1 => velocities.push(image.velocity()),
            _ => {
                velocities.push(image.velocity());
                accelerations.push(image.acceleration());
            }
        }
        if index + 1 < raws.len() {
            bench.stand(window - 1, *raw);
            bench.latch(*raw);
            let held = bench.half.inputs();
            if held.octets[4..] != image.octets[4..] {
                vector.fault("the values do not hold until the next sample");
            }
        }
    }
    vector.check("velocity", Value::from(velocities));
    vector.check("acceleration", Value::from(accelerations));
    if vector.expects("position") {
        vector.check("position", bench.half.position());
        vector.check_octets("input_octets", &bench.half.inputs().octets);
    }
}

/// Category overflow: positions around the physical overflow, and whether they jump.
pub(crate) fn overflow(vector: &Vector) {
    let variant = variant(vector);
    let scaling = |units: i64, range: i64| {
        let parameters = Parameters {
            scaling: true,
            measuring_units_per_revolution: u32::try_from(units).expect("32 bits"),
            total_measuring_range: u32::try_from(range).expect("32 bits"),
            ..Parameters::default_for(variant)
        };
        (parameters, Scaling::in_force(variant, Functionality::Class2, &parameters))
    };
    if let Some(pairs) = vector.get("mur_and_tmr") {
        let number = |value: &Value| value.as_i64().expect("a whole number");
        let residual = |pair: &Value| scaling(number(&pair[0]), number(&pair[1])).1.overflow_residual();
        let pairs = pairs.as_array().expect("pairs");
        vector.check("residuals", pairs.iter().map(residual).collect::<Vec<_>>());
        return;
    }
    let (parameters, scaling) = scaling(vector.number("mur"), vector.number("tmr"));
    let mut bench = Bench::delivered(variant);
    bench.exchange(Functionality::Class2, parameters);
    let (mut plain, mut endless) = (Vec::new(), Vec::new());
    for raw in vector.ints("raw_unwrapped") {
        bench.latch(raw);
        plain.push(bench.half.position());
        let range = i64::from(scaling.total_measuring_range());
        endless.push(scaling.unwrapped(raw).rem_euclid(range));
    }
    vector.check("plain", plain);
    vector.check("endless", endless);
}
