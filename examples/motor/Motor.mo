package Motor "A motor: current in, speed out"
  model Axis "One inertia on a motor; every effect of the catalogue is a parameter with a neutral value"
    parameter Real J(unit = "kg.m2", min = 1e-4, max = 1.0) = 0.02 "Inertia; data sheet";
    parameter Real k_t(unit = "N.m/A", min = 0.01, max = 10.0) = 0.5 "Torque constant; data sheet";
    parameter Real b(unit = "N.m.s/rad", min = 0.0, max = 1.0) = 0.02 "Viscous friction; data sheet";
    parameter Real tau_c(unit = "N.m", min = -5.0, max = 5.0) = 0.0 "Coulomb friction; neutral 0, bounds on both sides of it";
    parameter Real tau_g(unit = "N.m", min = -5.0, max = 5.0) = 0.0 "Torque of an unbalanced load; neutral 0";
    parameter Real tau_o(unit = "N.m", min = -5.0, max = 5.0) = 0.0 "Constant torque; neutral 0";
    input Real i(unit = "A") "Motor current, > 0 drives towards +phi";
    output Real w(unit = "rad/s", start = 0.0, fixed = true) "Speed";
    Real phi(unit = "rad", start = 0.0, fixed = true) "Angle; 0: the unbalanced load hangs down";
  equation
    der(phi) = w;
    J * der(w) = k_t * i - b * w - tau_c * noEvent(if w > 0.05 then 1.0 elseif w < -0.05 then -1.0 else w / 0.05) - tau_g * sin(phi) + tau_o;
  end Axis;
end Motor;
