package EMPS "Electro-mechanical positioning system: one measured prismatic axis, driven by a screw, in its position loop"
  // Known of the rig: drive gain, both loop gains, sample time. The nominal axis is a mass on a frictionless guide: every parameter named
  // "neutral" is an effect that the catalogue (examples/emps/effects) may switch on.

  package Types "Physical quantities, SI"
    type Position = Real(final quantity = "Length", final unit = "m", nominal = 0.1);
    type Velocity = Real(final quantity = "Velocity", final unit = "m/s", nominal = 0.1);
    type Acceleration = Real(final quantity = "Acceleration", final unit = "m/s2");
    type Force = Real(final quantity = "Force", final unit = "N", nominal = 10);
    type Mass = Real(final quantity = "Mass", final unit = "kg");
    type Voltage = Real(final quantity = "ElectricPotential", final unit = "V");
    type Time = Real(final quantity = "Time", final unit = "s");
    type Frequency = Real(final quantity = "Frequency", final unit = "Hz");
    type Ratio = Real(final unit = "1");
  end Types;

  import EMPS.Types.*;

  block Friction "Friction of guide and screw; nothing at its defaults"
    parameter Real F_v(unit = "N.s/m", min = 0, max = 1e5) = 0 "Viscous friction; neutral 0";
    parameter Force F_c(min = 0, max = 1e4) = 0 "Coulomb friction; neutral 0";
    parameter Real F_q(unit = "N.s2/m2", min = -1e6, max = 1e6) = 0 "Friction that grows with the square of speed; neutral 0";
    parameter Ratio direction_v(min = -1, max = 1) = 0 "Share by which F_v is higher for v > 0 and lower for v < 0; neutral 0";
    parameter Ratio direction_c(min = -1, max = 1) = 0 "Share by which F_c is higher for v > 0 and lower for v < 0; neutral 0";
    parameter Ratio stribeck(min = -1, max = 10) = 0 "Share by which Coulomb friction is higher at rest; neutral 0";
    parameter Velocity v_s(min = 1e-4, max = 10) = 0.02 "Stribeck speed";
    parameter Real slope(unit = "1/m", min = -100, max = 100) = 0 "Growth of Coulomb friction along the stroke, relative; neutral 0";
    parameter Boolean presliding = false "true: Coulomb friction builds up over x_pre (Dahl); neutral false";
    parameter Position x_pre(min = 1e-6, max = 1) = 1e-4 "Presliding displacement";
    parameter Velocity v_t(min = 1e-6, max = 1) = 5e-4 "Speed over which Coulomb friction changes sign";
    parameter Position q_mid = 0.12 "Middle of the stroke";
    input Velocity v "Speed";
    input Position q "Position";
    output Force F "Friction force, acts against v";
    Ratio z(start = 0, fixed = true) "Dahl's friction force, share of F_c";
  protected
    Ratio sign "Smooth sign of v";
    Ratio sense "Direction of friction";
  equation
    sign = tanh(v/v_t);
    der(z) = noEvent(if presliding then v/x_pre*(1 - z*sign) else 0);
    sense = noEvent(if presliding then z else sign);
    F = F_v*(1 + direction_v*sign)*v + F_q*v*noEvent(abs(v))
      + F_c*(1 + direction_c*sign)*(1 + stribeck*exp(-(v/v_s)^2))*(1 + slope*(q - q_mid))*sense;
  end Friction;

  model Axis "The axis in its loop: reference in, motor voltage out"
    parameter Mass M(min = 1, max = 1e4) = 95 "Moving mass, motor's inertia included";
    parameter Real gtau(unit = "N/V", min = 1, max = 1e4) = 35.1507 "Force per volt (data set)";
    parameter Ratio gain(min = 0.1, max = 10) = 1 "Drive gain / known drive gain; neutral 1";
    parameter Real kp(unit = "1/s", min = 0, max = 1e6) = 160.18 "Position loop (data set)";
    parameter Real kv(unit = "V.s/m", min = 0, max = 1e6) = 243.45 "Speed loop (data set)";
    parameter Time T(min = 1e-5, max = 1) = 1e-3 "Sample time; speed is the difference over two samples (seen in the data)";
    parameter Force offset(min = -1e4, max = 1e4) = 0 "Constant force against the motor; neutral 0";
    parameter Real stiffness(unit = "N/m", min = -1e6, max = 1e6) = 0 "Spring of cables, about mid-stroke; neutral 0";
    parameter Time delay_time(min = 0, max = 0.1) = 0 "Delay of the drive; neutral 0";
    parameter Time lag(min = 0, max = 1) = 0 "Lag of the drive; neutral 0";
    parameter Ratio share(min = 0, max = 0.95) = 0 "Share of the mass that hangs on a flexible joint; neutral 0";
    parameter Frequency f_joint(min = 1, max = 500) = 30 "Frequency of that mass against a fixed carriage";
    parameter Ratio damping(min = 0, max = 10) = 0.1 "Its damping";
    parameter Position q_start(min = -10, max = 10) = 0 "Position at the start";
    parameter Velocity v_start(min = -10, max = 10) = 0 "Speed at the start";
    input Position q_ref(start = 0) "Reference";
    input Voltage pulses(start = 0) "Voltage added to the controller's";
    output Voltage u "Motor voltage";
    output Position q(start = q_start, fixed = true) "Position";
    output Velocity v(start = v_start, fixed = true) "Speed";
    Acceleration a;
    Friction friction;
  protected
    Position q_late "Position two samples ago";
    discrete Voltage u_held(start = 0, fixed = true) "Voltage held over a sample";
    Voltage u_late "Voltage behind the delay";
    Force F_lag(start = 0, fixed = true) "Motor force behind the lag";
    Force F_target, F_motor;
    Position q_joint(start = q_start, fixed = true) "Position of the flexible mass";
    Velocity v_joint(start = v_start, fixed = true);
    Acceleration a_joint;
  equation
    q_late = delay(q, 2*T, 0.1);
    u = kv*(kp*(q_ref - q) - (q - q_late)/(2*T)) + pulses;
    // The reference is set at k*T, so the controller reads 1 us later; u itself is the law at any instant, at k*T that of the sample.
    when sample(1e-6, T) then
      u_held = u;
    end when;
    u_late = noEvent(if delay_time > 0 then delay(u_held, if delay_time > 0 then delay_time else 1e-3, 0.1) else u_held);
    F_target = gain*gtau*u_late;
    der(F_lag) = noEvent(if lag > 0 then (F_target - F_lag)/max(lag, 1e-4) else 0);
    F_motor = noEvent(if lag > 0 then F_lag else F_target);
    friction.v = v;
    friction.q = q;
    der(q) = v;
    der(v) = a;
    (1 - share)*M*a = F_motor - friction.F - offset - stiffness*(q - friction.q_mid) - share*M*a_joint;
    der(q_joint) = v_joint;
    der(v_joint) = a_joint;
    a_joint = (2*3.141592653589793*f_joint)^2*(q - q_joint) + 2*damping*2*3.141592653589793*f_joint*(v - v_joint);
  end Axis;
end EMPS;
