"""Static line of the two valves as the controllers know it: f_ax = -K_x (u_x - u_0x), f_az = K_z
(u_z - u_0z).

Least-squares lines through the steady forces of Tables 4.1 to 4.5.
"""

K_X = 186.0  # N/V
K_Z = 100.0  # N/V
U_0X = 0.635  # V, offset
U_0Z = 0.735  # V, offset
TAU_X = 0.30  # s, lag, §4.1.3
TAU_Z = 0.15  # s, lag, §4.1.3
