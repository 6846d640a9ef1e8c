export const en = {
  card: {
    label: "What is selected",
    lookThrough: "Look through it",
    showPhotograph: "Show the photograph",
    registration: {
      pending: "Not in a model yet.",
      registered: "Registered.",
      unregistered: "Not registered.",
      unused: "Not used.",
      excluded: "Excluded.",
      quarantined: "Quarantined.",
    },
  },
};
