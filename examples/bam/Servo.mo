package Servo "Position servo with a pendulum: firmware, motor, gearbox with friction, pendulum"
  // Nominal: the Coulomb + viscous rung (M1) as its authors fitted it. "neutral": an effect that the catalogue (effects/) may switch on.

  block Firmware "Proportional position law of the servo"
    parameter Real kp(unit = "1", min = 0, max = 1e5) = 400 "Gain setting";
    parameter Real scale(unit = "1/rad", min = 1e-5, max = 1) = 2.8774141e-3 "Duty per gain and radian: (4096/2pi)/(256*885)";
    parameter Real gain(unit = "1", min = 0.01, max = 100) = 1 "Real gain / gain setting; neutral 1";
    parameter Real limit(unit = "1", min = 0.01, max = 1) = 1 "Largest duty; neutral 1";
    input Real goal(unit = "rad") "Goal position";
    input Real q(unit = "rad") "Position";
    output Real duty(unit = "1") "Duty of the bridge, -1..1";
  equation
    duty = max(-limit, min(limit, gain*kp*scale*(goal - q)));
  end Firmware;

  block Motor "DC motor behind its gearbox, fed by a bridge"
    parameter Real k_t(unit = "N.m/A", min = 1e-3, max = 10) = 0.3866957639 "Torque constant at the output";
    parameter Real R(unit = "Ohm", min = 0.01, max = 100) = 4.0171292223 "Resistance";
    parameter Real V(unit = "V", min = 0.1, max = 100) = 7.4 "Supply";
    parameter Real R_s(unit = "Ohm", min = 0, max = 100) = 0 "Resistance of the supply: it sags under load; neutral 0";
    input Real duty(unit = "1") "Duty";
    input Real enable(unit = "1") "1: driven, 0: the bridge is open";
    input Real w(unit = "rad/s") "Speed";
    output Real T(unit = "N.m") "Torque";
  protected
    Real i(unit = "A") "Current";
  equation
    i = (duty*V - k_t*w)/(R + R_s*duty^2);
    T = noEvent(if enable > 0.5 then k_t*i else 0);
  end Motor;

  block Gearbox "Friction of the gearbox"
    parameter Real T_c(unit = "N.m", min = 0, max = 10) = 0.01283272 "Coulomb friction";
    parameter Real d(unit = "N.m.s", min = 0, max = 10) = 3.661672e-3 "Viscous friction";
    parameter Real T_s(unit = "N.m", min = -10, max = 10) = 0 "Extra Coulomb friction at rest (Stribeck); neutral 0";
    parameter Real w_s(unit = "rad/s", min = 1e-3, max = 100) = 3 "Speed at which it has faded to a third";
    parameter Real alpha(unit = "1", min = 0.1, max = 20) = 1 "Shape of that decay";
    parameter Real load(unit = "1", min = 0, max = 5) = 0 "Share of the gearbox torque; neutral 0";
    parameter Real load_motor(unit = "1", min = 0, max = 5) = 0 "Share of the motor's torque; neutral 0";
    parameter Real load_external(unit = "1", min = 0, max = 5) = 0 "Share of the load's torque; neutral 0";
    parameter Real load_external_rest(unit = "1", min = 0, max = 5) = 0 "Share of the load's torque that fades with speed; neutral 0";
    parameter Real load_motor_square(unit = "1/(N.m)", min = 0, max = 100) = 0 "Friction that grows with the square of the motor's torque; neutral 0";
    parameter Real load_external_square(unit = "1/(N.m)", min = 0, max = 100) = 0 "Friction that grows with the square of the load's torque; neutral 0";
    parameter Real factor(unit = "1", min = 0.01, max = 100) = 1 "Coulomb level as a whole / nominal; neutral 1";
    parameter Real w_t(unit = "rad/s", min = 1e-5, max = 1) = 2e-3 "Speed over which Coulomb friction changes sign";
    input Real T_m(unit = "N.m") "Torque of the motor";
    input Real T_e(unit = "N.m") "Torque of the load";
    input Real w(unit = "rad/s") "Speed";
    output Real T(unit = "N.m") "Friction, against w";
  protected
    Real rest(unit = "1") "1 at rest, 0 at speed";
    Real level(unit = "N.m") "Coulomb level";
  equation
    rest = exp(-(noEvent(abs(w))/w_s + 1e-12)^alpha);
    level = factor*(T_c + rest*(T_s + load_external_rest*noEvent(abs(T_e))) + load*noEvent(abs(T_e - T_m))
      + load_motor*noEvent(abs(T_m)) + load_external*noEvent(abs(T_e)) + load_motor_square*T_m^2 + load_external_square*T_e^2);
    T = d*w + level*tanh(w/w_t);
  end Gearbox;

  block Pendulum "Mass on a light arm"
    parameter Real m(unit = "kg", min = 0.01, max = 10) = 0.49 "Mass";
    parameter Real l(unit = "m", min = 0.01, max = 1) = 0.1 "Length of the arm";
    parameter Real q_offset(unit = "rad", min = -1, max = 1) = 0.030871 "Angle of the vertical";
    parameter Real tilt(unit = "rad", min = -1, max = 1) = 0 "Change of that angle; neutral 0";
    input Real q(unit = "rad") "Position";
    output Real T(unit = "N.m") "Torque of gravity";
    output Real J(unit = "kg.m2") "Inertia";
  equation
    T = -m*9.80665*l*sin(q + q_offset + tilt);
    J = m*l^2;
  end Pendulum;

  model Plant "Goal in, position and duty out"
    parameter Real armature(unit = "kg.m2", min = 1e-6, max = 1) = 1.8141673e-3 "Inertia of motor and gearbox at the output";
    parameter Real q_start(unit = "rad", min = -10, max = 10) = 0 "Position at the start";
    input Real goal(start = 0, unit = "rad") "Goal position";
    input Real enable(start = 1, unit = "1") "Torque enabled";
    output Real q(start = q_start, fixed = true, unit = "rad") "Position, 0 hangs down";
    output Real load(unit = "1") "The servo's own reading: 885 times the duty";
    output Real volts(unit = "V") "Supply at the servo";
    Firmware firmware;
    Motor motor;
    Gearbox gearbox;
    Pendulum pendulum;
  protected
    Real w(start = 0, fixed = true, unit = "rad/s") "Speed";
  equation
    firmware.goal = goal;
    firmware.q = q;
    motor.duty = firmware.duty;
    motor.enable = enable;
    motor.w = w;
    gearbox.T_m = motor.T;
    gearbox.T_e = pendulum.T;
    gearbox.w = w;
    pendulum.q = q;
    der(q) = w;
    (pendulum.J + armature)*der(w) = motor.T + pendulum.T - gearbox.T;
    load = noEvent(if enable > 0.5 then 885*firmware.duty else 0);
    volts = motor.V - motor.R_s*firmware.duty*motor.T/motor.k_t;
  end Plant;
end Servo;
