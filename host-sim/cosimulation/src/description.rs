//! `modelDescription.xml`.

use super::Kind;
use super::model::{Model, ModelError};
use super::variables::{Role, SET_POINT, Variable};
use std::fmt::Write;
use std::hash::{DefaultHasher, Hash, Hasher};
use thermyo_record::units::Unit;

/// Name of the shared library with the interface.
pub const LIBRARY: &str = "thermyo_fmu";

/// A token that ties a description to the resources with which it was built.
pub fn token(model: &Model) -> String {
    let mut hasher = DefaultHasher::new();
    let mut scenario = model.scenario().clone();
    // The tables' paths change on unpacking.
    for path in scenario.files().into_iter().flat_map(|(_, paths)| paths) {
        *path = None;
    }
    (model.kind().scenario_file(), scenario.render()).hash(&mut hasher);
    format!("thermyo-{}-{:016x}", env!("CARGO_PKG_VERSION"), hasher.finish())
}

/// The description of a model; `name` is that of the scenario.
pub fn describe(model: &Model, name: &str) -> Result<String, ModelError> {
    let run = model.scenario().run();
    let what = match model.kind() {
        Kind::Plant => "The plant of a scenario, its valves driven by the importer",
        Kind::WithCore => "The plant of a scenario and the core that drives it",
    };
    let (name, token, version) = (escaped(name), token(model), env!("CARGO_PKG_VERSION"));
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <fmiModelDescription fmiVersion=\"3.0\" modelName=\"{name}\" instantiationToken=\"{token}\" \
         description=\"{what}\" version=\"{version}\" generationTool=\"thermyo {version}\">\n\
         <CoSimulation modelIdentifier=\"{LIBRARY}\" canHandleVariableCommunicationStepSize=\"true\" \
         fixedInternalStepSize=\"{}\"/>\n\
         <UnitDefinitions>\n",
        run.step_s
    );
    for unit in model.scenario().units() {
        let exponents = unit.exponents.iter().filter(|(_, exponent)| *exponent != 0);
        let exponents: String =
            exponents.map(|(name, exponent)| format!(" {name}=\"{exponent}\"")).collect();
        xml += &format!("<Unit name=\"{}\"><BaseUnit{exponents}/></Unit>\n", unit.name);
    }
    let _ = write!(
        xml,
        "</UnitDefinitions>\n\
         <LogCategories><Category name=\"logStatusError\"/></LogCategories>\n\
         <DefaultExperiment startTime=\"0\" stopTime=\"{}\" stepSize=\"{}\"/>\n\
         <ModelVariables>\n",
        run.end_s(),
        run.step_s
    );
    let variables = model.variables();
    for (reference, variable) in (0..).zip(variables) {
        xml += &element(model, reference, variable)?;
    }
    xml += "</ModelVariables>\n<ModelStructure>\n";
    for kind in ["Output", "InitialUnknown"] {
        for (reference, variable) in variables.iter().enumerate() {
            if matches!(variable.role, Role::Plant | Role::Sampled) {
                xml += &format!("<{kind} valueReference=\"{reference}\"/>\n");
            }
        }
    }
    Ok(xml + "</ModelStructure>\n</fmiModelDescription>\n")
}

fn element(model: &Model, reference: u32, variable: &Variable) -> Result<String, ModelError> {
    let Variable { name, description, role } = variable;
    let start = |value: f64| format!(" start=\"{value}\"");
    let (kind, role) = match role {
        Role::Time => {
            ("Float64", " causality=\"independent\" variability=\"continuous\"".to_owned())
        }
        Role::Parameter => (
            "Boolean",
            format!(
                " causality=\"parameter\" variability=\"fixed\" start=\"{}\"",
                model.switch(reference)?
            ),
        ),
        Role::Input | Role::Opening => (
            "Float64",
            " causality=\"input\" variability=\"discrete\"".to_owned()
                + &start(model.number(reference)?),
        ),
        Role::Plant => ("Float64", " causality=\"output\" variability=\"continuous\"".to_owned()),
        Role::Sampled => ("Float64", " causality=\"output\" variability=\"discrete\"".to_owned()),
    };
    let unit =
        unit(model, variable).map_or_else(String::new, |unit| format!(" unit=\"{}\"", unit.name));
    let description = escaped(description);
    Ok(format!(
        "<{kind} name=\"{name}\" valueReference=\"{reference}\"{role}{unit} description=\"{description}\"/>\n"
    ))
}

/// A variable's unit; the set point has the unit of the scenario's drive.
fn unit(model: &Model, variable: &Variable) -> Option<&'static Unit> {
    if variable.name == SET_POINT {
        return model.scenario().set_point_unit();
    }
    variable.unit()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use thermyo_setup::parse;

    #[test]
    fn it_is_xml_with_every_variable() {
        let scenario = |joint: bool| -> Scenario {
            let origin = "test".as_ref();
            if joint {
                thermyo_joint::parse("[joint]\n", origin).unwrap().into()
            } else {
                parse("", origin).unwrap().into()
            }
        };
        for (kind, joint) in Kind::ALL.into_iter().flat_map(|kind| [(kind, false), (kind, true)]) {
            let model = Model::new(scenario(joint), kind).unwrap();
            let xml = describe(&model, "a <\"&\"> b").unwrap();
            let mut reader = quick_xml::Reader::from_str(&xml);
            let mut names = Vec::new();
            loop {
                match reader.read_event().unwrap() {
                    quick_xml::events::Event::Eof => break,
                    quick_xml::events::Event::Empty(element) => {
                        names.push(element.name().0.to_owned())
                    }
                    _ => (),
                }
            }
            let count = |name: &str| names.iter().filter(|n| *n == name).count();
            assert_eq!(count("Float64") + count("Boolean"), model.variables().len());
            assert_eq!(count("Output"), count("InitialUnknown"));
        }
    }

    /// The experiment ends as in `thermyo run`.
    #[test]
    fn its_experiment_ends_with_a_whole_step() {
        for (duration_s, step_s, end_s) in
            [(2.0, 0.003, 2.001), (2.3, 0.001, 2.3), (2.0, 0.0015, 1.9995)]
        {
            let text = format!("run = {{ duration_s = {duration_s:?}, step_s = {step_s:?} }}");
            let model = Model::new(parse(&text, "test".as_ref()).unwrap(), Kind::Plant).unwrap();
            let xml = describe(&model, "a").unwrap();
            let expected = format!("stopTime=\"{end_s}\" stepSize=\"{step_s}\"");
            assert!(xml.contains(&expected), "{expected}: {xml}");
        }
    }

    #[test]
    fn the_set_point_has_the_unit_of_the_drive() {
        for (kind, unit) in
            [("mass-flow", " unit=\"kg/s\""), ("pressure", " unit=\"Pa\""), ("contraction", "")]
        {
            let text = format!("[drive]\nkind = {kind:?}\n");
            let model = Model::new(parse(&text, "test".as_ref()).unwrap(), Kind::WithCore).unwrap();
            let xml = describe(&model, "a").unwrap();
            let line = xml.lines().find(|line| line.contains("\"set_point\"")).unwrap();
            assert!(line.contains(&format!("{unit} description=")), "{line}");
            assert_eq!(line.contains(" unit="), !unit.is_empty(), "{line}");
        }
    }

    #[test]
    fn the_token_tells_kinds_and_scenarios_apart() {
        let token =
            |text, kind| token(&Model::new(parse(text, "test".as_ref()).unwrap(), kind).unwrap());
        let plant = token("", Kind::Plant);
        assert_eq!(plant, token("", Kind::Plant));
        assert_ne!(plant, token("", Kind::WithCore));
        assert_ne!(plant, token("[run]\nseed = 2\n", Kind::Plant));
    }
}
