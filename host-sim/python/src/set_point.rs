//! A set point by its keyword: `pressure_pa=2.5e5`.

use model_core::SetPoint;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The only set point among the keywords; a period belongs to a flow.
pub fn set_point(
    pressure_pa: Option<f32>,
    contraction: Option<f32>,
    flow_kg_s: Option<f32>,
    period_s: Option<f32>,
    duty: Option<[f32; 2]>,
) -> PyResult<SetPoint> {
    match (pressure_pa, contraction, flow_kg_s, period_s, duty) {
        (Some(pressure_pa), None, None, None, None) => Ok(SetPoint::Pressure { pressure_pa }),
        (None, Some(contraction), None, None, None) => Ok(SetPoint::Contraction { contraction }),
        (None, None, Some(flow_kg_s), None, None) => Ok(SetPoint::MassFlow { flow_kg_s }),
        (None, None, Some(flow_kg_s), Some(period_s), None) => {
            Ok(SetPoint::MassFlowCycle { flow_kg_s, period_s })
        }
        (None, None, None, None, Some([inlet, outlet])) => Ok(SetPoint::Duty { inlet, outlet }),
        _ => Err(PyValueError::new_err(
            "must be one set point: pressure_pa, contraction, flow_kg_s (with period_s: a cycle) or duty",
        )),
    }
}
