// Turning without the rules of Gazebo's plugin, which takes a yaw rate below 0.1 rad/s for none and a speed below 0.1 m/s for none.
//
// Linked into a second plugin, this is found before the function of the same name in Gazebo's own: a library that is loaded by dlopen
// comes before what it needs, and Gazebo's calls are resolved by name.

#include <ignition/math/Pose3.hh>

#include <gazebo/plugins/SimpleTrackedVehiclePlugin.hh>

using ignition::math::Vector3d;

// A contact rubs along the velocity that it would have in the turn that is asked for: ω × (contact - body) + v, about the contact's
// normal. It changes steadily between straight, turn, and turn on the spot; of a chair at rest it is the belt's.
Vector3d gazebo::SimpleTrackedVehiclePlugin::ComputeFrictionDirection(
    const double v, const double omega, bool, const ignition::math::Pose3d &body, const Vector3d &left, const Vector3d &,
    const Vector3d &contact, const Vector3d &normal, const Vector3d &belt) const {
  const Vector3d along = normal.Cross(omega * (contact - body.Pos()) - v * left);
  return along.Length() > 0.0 ? along.Normalized() : belt;
}
