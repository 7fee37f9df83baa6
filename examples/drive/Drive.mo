package Drive "DC drive with an elastic joint: amplifier, motor, joint, load"
  // Parameters named "neutral" are effects that the catalogue (effects/) may switch on.

  block Amplifier "Voltage amplifier"
    parameter Real gain(unit = "1", min = 0.1, max = 10) = 1 "Voltage / command; neutral 1";
    parameter Real delay_time(unit = "s", min = 0, max = 0.05) = 0 "Delay; neutral 0";
    parameter Real lag(unit = "s", min = 0, max = 0.2) = 0 "First-order lag; neutral 0";
    input Real u(unit = "V") "Command";
    output Real v(unit = "V") "Voltage at the motor";
  protected
    Real u_late(unit = "V") "Command behind the delay";
    Real v_lag(start = 0, fixed = true, unit = "V") "Voltage behind the lag";
  equation
    u_late = noEvent(if delay_time > 0 then delay(u, if delay_time > 0 then delay_time else 1e-3, 0.06) else u);
    der(v_lag) = noEvent(if lag > 0 then (gain*u_late - v_lag)/max(lag, 1e-4) else 0);
    v = noEvent(if lag > 0 then v_lag else gain*u_late);
  end Amplifier;

  block Motor "DC motor with Coulomb and viscous friction"
    parameter Real R(unit = "Ohm", min = 0.01, max = 100) = 1.2 "Resistance of the winding";
    parameter Real L(unit = "H", min = 1e-5, max = 1) = 2.5e-3 "Inductance of the winding";
    parameter Real k_t(unit = "N.m/A", min = 1e-3, max = 10) = 0.06 "Torque constant";
    parameter Real J(unit = "kg.m2", min = 1e-7, max = 1) = 2e-4 "Inertia";
    parameter Real d(unit = "N.m.s", min = 0, max = 1) = 3e-4 "Viscous friction";
    parameter Real T_c(unit = "N.m", min = 0, max = 10) = 0.015 "Coulomb friction";
    parameter Real stribeck(unit = "1", min = -1, max = 10) = 0 "Share by which Coulomb friction is higher at rest; neutral 0";
    parameter Real w_s(unit = "rad/s", min = 0.1, max = 100) = 5 "Speed at which that share has faded to a third";
    parameter Real direction(unit = "1", min = -1, max = 1) = 0 "Share by which Coulomb friction is higher for w > 0, lower for w < 0; neutral 0";
    parameter Real w_t(unit = "rad/s", min = 1e-3, max = 10) = 0.02 "Speed over which Coulomb friction changes sign";
    input Real v(unit = "V") "Voltage";
    input Real T_j(unit = "N.m") "Torque of the joint, against the motor";
    output Real i(start = 0, fixed = true, unit = "A") "Current";
    output Real w(start = 0, fixed = true, unit = "rad/s") "Speed";
    output Real q(start = 0, fixed = true, unit = "rad") "Angle";
  protected
    Real sense(unit = "1") "Smooth sign of w";
    Real T_f(unit = "N.m") "Friction, against w";
  equation
    L*der(i) = v - R*i - k_t*w;
    sense = tanh(w/w_t);
    T_f = d*w + T_c*(1 + direction*sense)*(1 + stribeck*exp(-noEvent(abs(w))/w_s))*sense;
    J*der(w) = k_t*i - T_f - T_j;
    der(q) = w;
  end Motor;

  block Joint "Elastic joint"
    parameter Real k(unit = "N.m/rad", min = 1e-3, max = 1e5) = 2 "Stiffness";
    parameter Real c(unit = "N.m.s/rad", min = 0, max = 10) = 2e-3 "Damping";
    parameter Real k_3(unit = "N.m/rad3", min = -1e5, max = 1e5) = 0 "Cubic stiffness; neutral 0";
    input Real q_m(unit = "rad") "Motor's angle";
    input Real w_m(unit = "rad/s") "Motor's speed";
    input Real q_l(unit = "rad") "Load's angle";
    input Real w_l(unit = "rad/s") "Load's speed";
    output Real T(unit = "N.m") "Torque on the load";
  equation
    T = k*(q_m - q_l) + k_3*(q_m - q_l)^3 + c*(w_m - w_l);
  end Joint;

  block Load "Turning load"
    parameter Real J(unit = "kg.m2", min = 1e-7, max = 10) = 1e-3 "Inertia";
    parameter Real d(unit = "N.m.s", min = 0, max = 1) = 2e-4 "Viscous friction";
    parameter Real T_c(unit = "N.m", min = 0, max = 10) = 0 "Coulomb friction; neutral 0";
    parameter Real unbalance(unit = "N.m", min = -10, max = 10) = 0 "Weight times radius of an eccentric mass; neutral 0";
    parameter Real w_t(unit = "rad/s", min = 1e-3, max = 10) = 0.02 "Speed over which Coulomb friction changes sign";
    input Real T(unit = "N.m") "Torque of the joint";
    output Real w(start = 0, fixed = true, unit = "rad/s") "Speed";
    output Real q(start = 0, fixed = true, unit = "rad") "Angle";
  equation
    J*der(w) = T - d*w - T_c*tanh(w/w_t) - unbalance*sin(q);
    der(q) = w;
  end Load;

  model Plant "The drive: voltage command in; current, motor speed and load angle out"
    input Real u(start = 0, unit = "V") "Command";
    output Real i(unit = "A") "Motor current";
    output Real omega(unit = "rad/s") "Motor speed";
    output Real q(unit = "rad") "Load angle";
    Amplifier amplifier;
    Motor motor;
    Joint joint;
    Load load;
  equation
    amplifier.u = u;
    motor.v = amplifier.v;
    motor.T_j = joint.T;
    joint.q_m = motor.q;
    joint.w_m = motor.w;
    joint.q_l = load.q;
    joint.w_l = load.w;
    load.T = joint.T;
    i = motor.i;
    omega = motor.w;
    q = load.q;
  end Plant;
end Drive;
