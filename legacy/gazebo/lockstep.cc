// The chair's plugin for Gazebo 11: the tracked vehicle with moving contact surfaces (Pecka et al., IROS 2017, the paper's
// reference [20]), driven in lock-step over a loopback socket.
//
// Gazebo's own plugin takes a Twist on a topic, whenever it arrives. This one sets the two belts' speeds themselves, holds the
// world until it is told how many steps to go, and answers with the state after them: the same orders give the same run.
//
// One order is eight doubles, one answer COLUMNS doubles, both little-endian; see src/treadline/plant/gazebo/_gzserver.py, which speaks
// the other end. A client that closes the socket ends the process.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>

#include <gazebo/common/Console.hh>
#include <gazebo/common/Events.hh>
#include <gazebo/gazebo_config.h>
#include <gazebo/physics/physics.hh>
#include <gazebo/rendering/Camera.hh>
#include <gazebo/sensors/sensors.hh>
#include <gazebo/plugins/SimpleTrackedVehiclePlugin.hh>

namespace treadline {

using gazebo::physics::JointPtr;
using ignition::math::Vector3d;

constexpr double PROTOCOL = 1.0;
constexpr double NO_REACH_M = -1e3;  // of a chair that touches nothing
constexpr int SEAT_GAIN = 60, FLIPPER_GAIN = 10;  // 1/s: how fast a servo takes up what is left to its target
constexpr double STIFF_N_M = 1e4;  // a seat's gear holds whatever sits on it
constexpr unsigned int SCENE_US = 10000;
constexpr double FOLLOWED = 0.01;  // per order, 10 ms: the film's camera is a second behind the chair, and does not shake with it

enum Order { STEPS, LEFT, RIGHT, SEAT, FLIPPER, FLIPPER_RATE, FRICTION, FRICTION_ACROSS, ORDERS };

struct Answer {
  double t_s, position[3], orientation[4], velocity[3], rate[3], seat, flipper, flipper_torque, contacts, reach[4];
};
constexpr std::size_t COLUMNS = sizeof(Answer) / sizeof(double);

class Lockstep : public gazebo::SimpleTrackedVehiclePlugin {
 public:
  void Load(gazebo::physics::ModelPtr model, sdf::ElementPtr sdf) override {
    SimpleTrackedVehiclePlugin::Load(model, sdf);
    model_ = model;
    film_ = sdf->Get<std::string>("film", "").first;
    chair_ = model->GetLink(sdf->Get<std::string>("body"));
    seat_ = model->GetJoint("seat_joint");
    flipper_ = model->GetJoint("flipper_joint");
    flipper_torque_n_m_ = sdf->Get<double>("flipper_torque", 0.0).first;
    seat_start_ = sdf->Get<double>("seat_start", 0.0).first;
    flipper_start_ = sdf->Get<double>("flipper_start", 0.0).first;
    // SDF has no word for it. Without, ODE iterates on long after the contacts' forces have settled.
    model->GetWorld()->Physics()->SetParam("sor_lcp_tolerance", sdf->Get<double>("solver_tolerance", 0.0).first);
    Listen(sdf->Get<int>("port", 0).first);
    begin_ = gazebo::event::Events::ConnectWorldUpdateBegin([this](const auto&) { Before(); });
  }

  void Init() override {
    SimpleTrackedVehiclePlugin::Init();
    // Gazebo tells belts apart by their links; light links on a heavy chassis would hang loose in ODE's iterations, so here
    // both belts are parts of the same bodies, and their shapes say which is which.
    for (const auto& link : model_->GetLinks())
      for (const auto& collision : link->GetCollisions())
        collision->SetCategoryBits(ROBOT_CATEGORY | BELT_CATEGORY | (collision->GetName().rfind("left", 0) == 0 ? LEFT_CATEGORY : 0u));
    Put(seat_, seat_start_, STIFF_N_M);
    if (flipper_) Put(flipper_, flipper_start_, flipper_torque_n_m_);
    camera_ = model_->GetWorld()->ModelByName("film");
    if (camera_) beside_ = camera_->WorldPose().Pos() - chair_->WorldPose().Pos();
    contacts_ = gazebo::event::Events::ConnectBeforePhysicsUpdate([this](const auto&) { Reach(); });
  }

 private:
  static void Put(const JointPtr& joint, double angle, double torque_n_m) {
    joint->SetPosition(0, angle);
    joint->SetParam("fmax", 0, torque_n_m);
    joint->SetParam("vel", 0, 0.0);
    joint->SetProvideFeedback(true);
  }

  void Listen(int port) {
    listener_ = socket(AF_INET, SOCK_STREAM, 0);
    const int on = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    here.sin_port = htons(static_cast<std::uint16_t>(port));
    if (bind(listener_, reinterpret_cast<sockaddr*>(&here), sizeof here) != 0 || listen(listener_, 1) != 0) {
      gzerr << "treadline: port " << port << " is taken" << std::endl;
      std::_Exit(3);
    }
  }

  void Accept() {
    client_ = accept(listener_, nullptr, nullptr);
    const int on = 1;
    setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    // What the client must know before it trusts the rest.
    const std::array<double, 4> greeting{PROTOCOL, GAZEBO_MAJOR_VERSION, ORDERS, COLUMNS};
    Send(greeting.data(), sizeof greeting);
  }

  // Before a step: answer when the last order is done, then wait for the next one.
  void Before() {
    if (client_ < 0) Accept();
    if (camera_ && !images_) Film();
    if (flipper_ && is_under_way_) flipper_torque_ += FlipperTorque();  // of single steps ODE's forces jump
    if (steps_left_ == 0) {
      if (is_under_way_) {
        const Answer answer = State();
        Send(&answer, sizeof answer);
      }
      Receive(order_.data(), sizeof order_);
      steps_left_ = static_cast<long>(order_[STEPS]);
      is_under_way_ = true;
      std::fill_n(reach_, 4, NO_REACH_M);
      contact_count_ = 0.0;
      flipper_torque_ = 0.0;
      Obey();
    }
    Servo(seat_, order_[SEAT], 0.0, SEAT_GAIN);
    if (flipper_) Servo(flipper_, order_[FLIPPER], order_[FLIPPER_RATE], FLIPPER_GAIN);
    --steps_left_;
  }

  void Obey() {
    if (camera_) Follow();
    SetTrackVelocityImpl(order_[LEFT], order_[RIGHT]);
    if (order_[FRICTION] == friction_[0] && order_[FRICTION_ACROSS] == friction_[1]) return;
    friction_ = {order_[FRICTION], order_[FRICTION_ACROSS]};
    SetTrackMu(friction_[0]);
    SetTrackMu2(friction_[1]);
    UpdateTrackSurface();
  }

  // Keeps the film's images, named by the time at which they were taken. A camera appears some steps after the world, when its
  // scene is drawn; until then the world goes slowly, so that the film begins with the run.
  void Film() {
    const auto sensor = std::dynamic_pointer_cast<gazebo::sensors::CameraSensor>(gazebo::sensors::get_sensor("film"));
    if (!sensor || !sensor->Camera() || !sensor->Camera()->Initialized()) {
      usleep(SCENE_US);
      return;
    }
    images_ = sensor->Camera()->ConnectNewImageFrame(
        [this, sensor](const unsigned char* image, unsigned int width, unsigned int height, unsigned int depth, const std::string& format) {
          const auto name = film_ + "/" + std::to_string(sensor->LastMeasurementTime().Double()) + ".jpg";
          gazebo::rendering::Camera::SaveFrame(image, width, height, static_cast<int>(depth), format, name);
        });
  }

  // The film's camera keeps its place beside the chair and its direction.
  void Follow() {
    auto pose = camera_->WorldPose();
    pose.Pos() += FOLLOWED * (chair_->WorldPose().Pos() + beside_ - pose.Pos());
    camera_->SetWorldPose(pose);
  }

  static void Servo(const JointPtr& joint, double target, double rate, double gain) {
    joint->SetParam("vel", 0, rate + gain * (target - joint->Position(0)));
  }

  // The motor's torque on the flipper; Gazebo reports the opposite, what the flipper exerts on the joint.
  double FlipperTorque() const { return -flipper_->GetForceTorque(0).body2Torque.Dot(flipper_->LocalAxis(0)); }

  // How far the belts' contacts reach from the chair's origin: front, rear, left, right.
  void Reach() {
    const auto manager = model_->GetWorld()->Physics()->GetContactManager();
    const auto pose = chair_->WorldPose();
    for (unsigned int i = 0; i < manager->GetContactCount(); ++i) {
      const auto* contact = manager->GetContact(i);
      if (contact->collision1->GetModel() != model_ && contact->collision2->GetModel() != model_) continue;
      contact_count_ = std::max(contact_count_, static_cast<double>(manager->GetContactCount()));
      for (int k = 0; k < contact->count; ++k) {
        const Vector3d at = pose.Rot().RotateVectorReverse(contact->positions[k] - pose.Pos());
        reach_[0] = std::max(reach_[0], at.X());
        reach_[1] = std::max(reach_[1], -at.X());
        reach_[2] = std::max(reach_[2], at.Y());
        reach_[3] = std::max(reach_[3], -at.Y());
      }
    }
  }

  Answer State() const {
    const auto pose = chair_->WorldPose();
    const auto velocity = chair_->WorldLinearVel();
    const auto rate = chair_->RelativeAngularVel();
    Answer answer{};
    answer.t_s = model_->GetWorld()->SimTime().Double();
    for (int i = 0; i < 3; ++i) {
      answer.position[i] = pose.Pos()[i];
      answer.velocity[i] = velocity[i];
      answer.rate[i] = rate[i];
    }
    answer.orientation[0] = pose.Rot().W();
    answer.orientation[1] = pose.Rot().X();
    answer.orientation[2] = pose.Rot().Y();
    answer.orientation[3] = pose.Rot().Z();
    answer.seat = seat_->Position(0);
    if (flipper_) {
      answer.flipper = flipper_->Position(0);
      answer.flipper_torque = flipper_torque_ / order_[STEPS];
    }
    answer.contacts = contact_count_;
    std::copy_n(reach_, 4, answer.reach);
    return answer;
  }

  void Send(const void* data, std::size_t size) {
    for (auto* from = static_cast<const char*>(data); size > 0;) {
      const ssize_t sent = send(client_, from, size, MSG_NOSIGNAL);
      if (sent <= 0) std::_Exit(0);
      from += sent;
      size -= static_cast<std::size_t>(sent);
    }
  }

  void Receive(void* data, std::size_t size) {
    for (auto* to = static_cast<char*>(data); size > 0;) {
      const ssize_t got = recv(client_, to, size, 0);
      if (got <= 0) std::_Exit(0);  // nobody is there any more
      to += got;
      size -= static_cast<std::size_t>(got);
    }
  }

  gazebo::physics::ModelPtr model_, camera_;
  Vector3d beside_;
  std::string film_;
  gazebo::physics::LinkPtr chair_;
  JointPtr seat_, flipper_;
  double flipper_torque_n_m_ = 0.0, seat_start_ = 0.0, flipper_start_ = 0.0, flipper_torque_ = 0.0;
  std::array<double, ORDERS> order_{};
  std::array<double, 2> friction_{};
  double reach_[4] = {NO_REACH_M, NO_REACH_M, NO_REACH_M, NO_REACH_M};
  double contact_count_ = 0.0;
  long steps_left_ = 0;
  bool is_under_way_ = false;
  int listener_ = -1, client_ = -1;
  gazebo::event::ConnectionPtr begin_, contacts_, images_;
};

GZ_REGISTER_MODEL_PLUGIN(Lockstep)

}  // namespace treadline
